"""One fold: diagnose the campaign, predict the other, compare."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.real_data.data_set import Fold, nrmse, scatter
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.document import Cause, Diagnosis
from rigtwin.gap.predict import Predicted, predict
from rigtwin.sim.campaign_folder import load_campaign


@dataclass(frozen=True)
class Judged:
    """What the diagnosis said of a fold, and how well it predicts."""

    fold: str
    verdict: str
    causes: tuple[str, ...]  # the first three, with their probabilities
    sentence: str
    before: float  # NRMSE of the nominal model on the held-out runs
    after: float  # the same with the cause; equal where none is named
    floor: float  # what neighbouring lines of these runs leave of each other
    seconds: float  # of processor
    failure: str = ""  # message of an error, where there is no answer


def judged(fold: Fold, say: Callable[[str], None]) -> Judged:
    """Diagnose and predict; an error is a result and says so."""
    say(f"{fold.name}: diagnosing")
    begin = time.process_time()
    held = load_campaign(fold.held)
    try:
        diagnosis = diagnose(load_campaign(fold.train)).diagnosis
        seconds = time.process_time() - begin
        predicted = predict(Diagnosis.from_json(diagnosis.to_json()), held)
    except (ValueError, RuntimeError, ArithmeticError) as error:
        nothing = float("nan")
        words = f"{type(error).__name__}: {error}"
        say(f"{fold.name}: failed, {words}")
        return Judged(fold.name, "none", (), "", nothing, nothing, nothing, time.process_time() - begin, words)
    return Judged(
        fold=fold.name,
        verdict=diagnosis.verdict,
        causes=tuple(_words(cause) for cause in diagnosis.causes[:3]),
        sentence=diagnosis.sentence,
        before=_mean(predicted, lambda p: nrmse(p.run.H, p.nominal.H)),
        after=_mean(predicted, lambda p: nrmse(p.run.H, p.corrected.H)),
        floor=_mean(predicted, lambda p: float(np.mean([scatter(column) for column in p.run.H.T]))),
        seconds=seconds,
    )


def _mean(predicted: tuple[Predicted, ...], of: Callable[[Predicted], float]) -> float:
    return float(np.mean([of(each) for each in predicted]))


def _words(cause: Cause) -> str:
    """'attached_mass at node 3 (0.62)'."""
    place = cause.location
    where = f" at node {place.node}" if place.node is not None else ""
    where = f" at {place.x_m:.3g} m" if place.x_m is not None else where
    return f"{' + '.join(cause.effects)}{where} ({cause.probability:.2g})"
