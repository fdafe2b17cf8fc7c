"""``rigtwin estimate``: bearing stiffness from measured runs, resonance lists or plain numbers."""

from __future__ import annotations

import math

from rigtwin.api.estimates import ANSWER_HEADER, Answers
from rigtwin.console import note, print_json, say, table


def print_answers(answers: Answers, *, as_json: bool) -> None:
    """Print what came out."""
    for remark in answers.remarks:
        note(remark)
    if as_json:
        print_json({"estimates": [answer.record() for answer in answers]})
        return
    table(ANSWER_HEADER, [answer.row() for answer in answers])
    for answer in answers:
        for objection in answer.objections:
            say(f"{answer.test}: not valid: {objection}")
    if beside := [answer.workshop_error for answer in answers if math.isfinite(answer.workshop_error)]:
        note(
            "the interval holds the errors of the measurement alone; a rig that differs from its drawing as usual, in "
            f"the shaft's modulus, its lengths and the disks, moves k_b by {100 * max(beside):.2g} % (standard error); "
            "a campaign folder says how well a rig is known, and its intervals hold that"
        )
    if any(answer.method == "responses" for answer in answers):
        note("found by all lines; the interval holds what is unknown of tolerances, dampings, gains and drifts")
    if any(answer.method == "model" for answer in answers):
        note("found on the finite-element model of the rig by both shifts; the amplitude ratio is not used")
