"""Diagnoses of data as laboratories have them: ``python -m benchmarks.lab_data`` writes docs/lab-data.md; half an hour.

The same campaigns are diagnosed whole and with something taken away: phases, lines, values, nodes, a support, errors.
"""

from __future__ import annotations

import itertools
import json
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.campaigns import tuning_campaigns
from benchmarks.page import DOCS, machine, table
from rigtwin.blind.judge.score import Label, Outcome, outcome
from rigtwin.gap.diagnose import diagnose
from rigtwin.scale_out import executor
from rigtwin.sim.campaign import Run
from rigtwin.sim.campaign_folder import load_campaign

# Campaigns of the tuning split that no threshold has seen; linear effects and artefacts, seven nodes.
SEED, COUNT, WORKERS = 22, 20, 2

LINES_LEFT, VALUES_LOST, NODES_LEFT = 0.6, 0.1, (2, 3, 6)


@dataclass(frozen=True)
class Loss:
    """What is taken away from every run; effects that nothing shows then."""

    words: str
    of: Callable[[Run], Run | None]
    hides: tuple[str, ...] = ()


def _whole(run: Run) -> Run:
    return run


def _magnitudes(run: Run) -> Run:
    return replace(run, H=np.abs(run.H), magnitude_only=True, harmonics={})


def _uneven(run: Run) -> Run:
    kept = np.random.default_rng(0).random(len(run.frequency_hz)) < LINES_LEFT
    return replace(run.on_lines(kept), swept_hz=None)


def _with_holes(run: Run) -> Run:
    lost = np.random.default_rng(1).random(run.H.shape) < VALUES_LOST
    return replace(run, H=np.where(lost, np.nan, run.H), harmonics={})


def _few_nodes(run: Run) -> Run:
    return run.with_channels([i for i, channel in enumerate(run.channels) if channel.node in NODES_LEFT])


def _scaled_errors(run: Run, factor: float) -> Run:
    return replace(run, std=None if run.std is None else factor * run.std)


def _without_errors(run: Run) -> Run:
    return replace(run, std=None)


def _only(run: Run, support: str) -> Run | None:
    return run if run.support == support else None


LOSSES = (
    Loss("nothing", _whole),
    Loss("all phases", _magnitudes, hides=("sensor_delay",)),
    Loss(f"{100 * (1 - LINES_LEFT):.0f} % of the lines, at random", _uneven, hides=("fast_sweep",)),
    Loss(f"{100 * VALUES_LOST:.0f} % of the values, at random", _with_holes),
    Loss(f"all nodes but {', '.join(map(str, NODES_LEFT))}", _few_nodes),
    Loss("the standard errors", _without_errors),
    Loss("half of each standard error", partial(_scaled_errors, factor=0.5)),
    Loss("nothing; standard errors doubled", partial(_scaled_errors, factor=2.0)),
    Loss("the runs on rigid supports", partial(_only, support="bearing"), hides=("compliant_rigid_support",)),
    Loss("the runs on bearings", partial(_only, support="rigid"), hides=("bearings",)),
)


def main() -> None:
    """Make, diagnose, print, write the page."""
    outcomes: dict[str, list[Outcome]] = {loss.words: [] for loss in LOSSES}
    with tempfile.TemporaryDirectory() as folder, executor(workers=WORKERS) as pool:
        campaigns = _campaigns(Path(folder))
        asked = {
            pool.submit(_diagnosed, path, label, number): loss.words
            for path, label in campaigns
            for number, loss in enumerate(LOSSES)
            if not _hidden(label, loss)
        }
        for done, future in enumerate(as_completed(asked), start=1):
            outcomes[asked[future]].append(future.result())
            print(f"{done} of {len(asked)} diagnoses", end="\r", flush=True)
    print()
    page = _page(outcomes)
    (DOCS / "lab-data.md").write_text(page, encoding="utf-8")
    print(page)


def _campaigns(folder: Path) -> list[tuple[Path, Label]]:
    """The first that are linear and have seven nodes, with their labels."""
    made = tuning_campaigns("W1", SEED, folder)
    return list(itertools.islice((each for each in made if each[1].sensors == "all"), COUNT))


def _hidden(label: Label, loss: Loss) -> bool:
    (effect,) = label.effects
    return effect["id"] in loss.hides or effect["location"]["kind"] in loss.hides


def _diagnosed(path: Path, label: Label, number: int) -> Outcome:
    campaign = load_campaign(path)
    runs = (LOSSES[number].of(run) for run in campaign.runs)
    lessened = replace(campaign, runs=tuple(run for run in runs if run is not None))
    return outcome(label, json.loads(diagnose(lessened).diagnosis.to_json()))


def _page(outcomes: dict[str, list[Outcome]]) -> str:
    header = (
        "taken away",
        "campaigns",
        "named first",
        "in the answered set",
        "no gap",
        "unknown",
        "another named",
        "k_b",
    )
    return f"""# Campaigns as laboratories have them

Laboratory data are often incomplete. This page says how well the diagnosis works when a part of the data is missing.
`python -m benchmarks.lab_data` writes it ({machine()}).

The {COUNT} campaigns come from the generator of the blind benchmark. Each hides one linear effect or one error of the
measurement chain, large or small, and has two supports, 280 lines and seven nodes. Every campaign is diagnosed
complete, and then again with a part taken away. Some effects leave no trace in what remains, for example a delay when
there are no phases, or an effect of a support that was not measured. Such campaigns do not count in that row.

The column "named first" counts the campaigns whose first answer is right, and "in the answered set" those in which the
right effect is among the answers. The column "k_b" is the median relative error of the bearing stiffness.

{table(header, [_row(words, of) for words, of in outcomes.items()])}"""


def _row(words: str, of: Sequence[Outcome]) -> tuple[str, ...]:
    counts = (
        sum(o.top_right for o in of),
        sum(o.set_right for o in of),
        sum(o.verdict == "no_gap" for o in of),
        sum(o.verdict == "unknown" for o in of),
        sum(o.verdict == "cause" and not o.top_right for o in of),
    )
    errors = [o.k_b_error for o in of if np.isfinite(o.k_b_error)]
    return words, str(len(of)), *map(str, counts), f"{np.median(errors):.1e}" if errors else "–"


if __name__ == "__main__":
    main()
