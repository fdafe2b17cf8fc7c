"""``rigtwin estimate``: bearing stiffness from measured runs, resonance lists or plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rigtwin.commands.fmus import SHIPPED_RIG, existing, open_estimator, trained_rig
from rigtwin.console import note, print_json, say, table
from rigtwin.estimator.features import Features, features_of_peaks, features_of_runs
from rigtwin.estimator.runtime import Estimate
from rigtwin.estimator.validity import objections
from rigtwin.exits import UserError
from rigtwin.sim.campaign import Campaign, MeasurementError, Quantity, Run, SupportKind
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats import read_run
from rigtwin.wording import interval, stiffness_with_error, with_error

# A ratio read off a curve without an error of its own is trusted to this share.
RATIO_TRUST = 0.1


@dataclass(frozen=True)
class Ratio:
    """Amplitude ratio given on the command line, where only resonances survive."""

    value: float
    std: float


@dataclass(frozen=True)
class Numbers:
    """Shifts and ratio given on the command line; what was not given is None."""

    delta_f1: float | None
    delta_f2: float | None
    amplitude_ratio: float | None
    delta_f1_std: float | None
    delta_f2_std: float | None
    amplitude_ratio_std: float | None


@dataclass(frozen=True)
class Answer:
    """One test and what the estimator says about it."""

    test: str
    features: Features
    estimate: Estimate
    objections: list[str]

    def record(self) -> dict[str, Any]:
        """For a machine."""
        return {"test": self.test, **asdict(self.features), **asdict(self.estimate), "why_not_valid": self.objections}


def estimate(
    paths: Sequence[Path], numbers: Numbers, settings: dict[str, Any], estimator: Path | None, *, trust: bool = False
) -> list[Answer]:
    """Answer every test that the arguments hold.

    Parameters
    ----------
    paths : a rigid and a bearing run, or a campaign folder, or nothing
    numbers : what was given in numbers
    settings : how the two runs were measured, where their files do not say it
    estimator : StiffnessEstimator.fmu or ONNX file, default the shipped network
    trust : whether an FMU may run that was built elsewhere

    Raises
    ------
    UserError, MeasurementError : nothing can be estimated from this
    """
    with open_estimator(estimator, trust=trust) as (ask, card):
        return [
            Answer(test, features, answer, objections(features, answer, card))
            for test, features in _tests(paths, numbers, settings, card)
            for answer in [ask(features)]
        ]


def answers_of_runs(runs: Sequence[Run], rig: str, estimator: Path | None, *, trust: bool = False) -> list[Answer]:
    """Answer every rigid and bearing pair among some runs."""
    with open_estimator(estimator, trust=trust) as (ask, card):
        _check_rig(rig, card)
        return [
            Answer(test, features, answer, objections(features, answer, card))
            for test, features in _pairs(runs, card)
            for answer in [ask(features)]
        ]


def _tests(
    paths: Sequence[Path], numbers: Numbers, settings: dict[str, Any], card: dict[str, Any]
) -> list[tuple[str, Features]]:
    if len(paths) == 2:
        _refuse(numbers)
        return list(_pairs(_read_pair(paths, settings), card))
    if len(paths) == 1 and paths[0].is_file():
        raise UserError(f"{paths[0]}: one file alone; give two, first the run on rigid supports, then that on bearings")
    if len(paths) == 1:
        campaign = load_campaign(paths[0])
        _check_rig(campaign.rig, card)
        if settings:
            raise UserError(f"{option(min(settings))}: the campaign says that of its runs; change its campaign.toml")
        return _campaign_tests(campaign, numbers, card)
    if paths:
        raise UserError(f"{len(paths)} files given; give a rigid and a bearing run, or one campaign folder")
    return [("numbers given", _features(numbers))]


def _refuse(numbers: Numbers, allowed: Sequence[str] = ()) -> None:
    """What files say is not said again on the command line, but for what they cannot say."""
    given = [option(name) for name, value in asdict(numbers).items() if value is not None and name not in allowed]
    if given:
        raise UserError(f"{', '.join(given)}: numbers go without files that tell them; give either")


def _read_pair(paths: Sequence[Path], settings: dict[str, Any]) -> list[Run]:
    for path in paths:
        if path.is_dir():
            raise UserError(f"{path}: a folder; give two run files, or one campaign folder alone")
    supports: tuple[SupportKind, SupportKind] = ("rigid", "bearing")
    return [_read(existing(path), support, settings) for path, support in zip(paths, supports, strict=True)]


def _read(path: Path, support: SupportKind, settings: dict[str, Any]) -> Run:
    """A run on this support; a file that says another one is refused, for the two may be mixed up."""
    try:
        said = read_run(path, **settings).support
    except MeasurementError:  # it says none, as no CSV does, or it is wrong and the next line says how
        said = support
    if said != support:
        raise UserError(f"{path}: a run on {said} support; give first the run on rigid supports, then that on bearings")
    return read_run(path, support=support, **settings)


def run_settings(excitation_node: int | None, quantity: Quantity | None) -> dict[str, Any]:
    """Settings of a run that were said on the command line."""
    said = {"excitation_node": excitation_node, "quantity": quantity}
    return {key: value for key, value in said.items() if value is not None}


def _check_rig(rig: str, card: dict[str, Any]) -> None:
    """A network knows one rig; refuse a campaign of another."""
    name = rig if rig == SHIPPED_RIG else _rig_name(rig)
    if name != trained_rig(card):
        raise UserError(
            f"the campaign's rig is {name}, the estimator was trained for {trained_rig(card)}; "
            f"train one with rigtwin train --rig {rig} and give it with --estimator"
        )


def _rig_name(rig: str) -> str:
    from rigtwin.rotor.geometry.rig import load_rig

    return load_rig(rig).name


def _campaign_tests(campaign: Campaign, numbers: Numbers, card: dict[str, Any]) -> list[tuple[str, Features]]:
    if campaign.runs:
        _refuse(numbers)
        return list(_pairs(campaign.runs, card))
    _refuse(numbers, allowed=("amplitude_ratio", "amplitude_ratio_std"))
    return [("resonance lists", features_of_campaign_peaks(campaign, _ratio(numbers)))]


def features_of_campaign_peaks(campaign: Campaign, ratio: Ratio) -> Features:
    """Features of a campaign that holds resonance lists only. Raises UserError where a support is missing."""
    lists = {peaks.support: peaks for peaks in campaign.peaks}
    if set(lists) != {"rigid", "bearing"} or len(campaign.peaks) != 2:
        raise UserError(
            f"campaign {campaign.title!r}: one [[peaks]] of each support, rigid and bearing, is needed; "
            f"it has {len(campaign.peaks)}"
        )
    return features_of_peaks(lists["rigid"], lists["bearing"], ratio.value, ratio.std)


def _ratio(numbers: Numbers) -> Ratio:
    if numbers.amplitude_ratio is None:
        raise UserError(
            "resonance lists say nothing about amplitudes; give --amplitude-ratio A1/A0 (bearing over rigid support) "
            "and --amplitude-ratio-std"
        )
    std = numbers.amplitude_ratio_std
    if std is None:
        std = RATIO_TRUST * numbers.amplitude_ratio
        note(f"--amplitude-ratio-std is not given; {100 * RATIO_TRUST:g} % of the ratio is taken")
    return Ratio(_finite("--amplitude-ratio", numbers.amplitude_ratio), _finite("--amplitude-ratio-std", std))


def _features(numbers: Numbers) -> Features:
    given = asdict(numbers)
    missing = [option(name) for name, value in given.items() if value is None]
    if len(missing) == len(given):
        raise UserError("nothing to estimate from: give RIGID_FILE BEARING_FILE, a campaign folder, or numbers")
    if missing:
        raise UserError(f"{', '.join(missing)} missing; shifts, ratio and all three standard errors are needed")
    return Features(**{name: _finite(option(name), value) for name, value in given.items()})


def option(name: str) -> str:
    """'--delta-f1-std' of 'delta_f1_std'."""
    return "--" + name.replace("_", "-")


def _finite(what: str, value: float) -> float:
    if not math.isfinite(value):
        raise UserError(f"{what} {value}: give a finite number")
    return value


def _pairs(runs: Sequence[Run], card: dict[str, Any]) -> Iterator[tuple[str, Features]]:
    """Each bearing run with the rigid run of the same exciter place; standing rotor only.

    Of runs whose response is not per force, that is of the same force as well. A pair that cannot be used is told, as
    long as another can. Raises MeasurementError where there is none, or the exciter stood elsewhere than in training.
    """
    node = card.get("excitation_node", 2)
    usable = [run for run in runs if run.spin_rpm == 0 and run.excitation_node == node]
    rigid = {_alike(run): run for run in reversed(usable) if run.support == "rigid"}
    pairs = [(rigid[_alike(run)], run) for run in usable if run.support == "bearing" and _alike(run) in rigid]
    if not pairs:
        raise MeasurementError(
            f"no rigid and bearing run of the standing rotor with the force at node {node} in the same plane; "
            f"the estimator needs both; there are: {'; '.join(map(_describe, runs))}"
        )
    refused: list[MeasurementError] = []
    for first, second in pairs:
        try:
            features = features_of_runs(first, second)
        except MeasurementError as error:
            refused.append(error)
        else:
            yield f"{first.name} / {second.name}", features
    if len(refused) == len(pairs):
        raise refused[0]
    for error in refused:
        note(f"left out: {error}")


def _alike(run: Run) -> tuple[object, ...]:
    """What a rigid and a bearing run must have in common."""
    return run.excitation_plane, run.quantity, run.force_amplitude_N if run.quantity == "acceleration" else None


def _describe(run: Run) -> str:
    force = f" at {run.force_amplitude_N:g} N" if run.quantity == "acceleration" and run.force_amplitude_N else ""
    place = f"node {run.excitation_node} {run.excitation_plane}"
    return f"{run.name} ({run.support}, {place}, {run.quantity}{force}, {run.spin_rpm:g} rpm)"


def print_answers(answers: Sequence[Answer], *, as_json: bool) -> None:
    """Print what came out."""
    if as_json:
        print_json({"estimates": [answer.record() for answer in answers]})
        return
    table(ANSWER_HEADER, [answer_row(answer) for answer in answers])
    for answer in answers:
        for objection in answer.objections:
            say(f"{answer.test}: not valid: {objection}")


ANSWER_HEADER = ("test", "Δf1, Hz", "Δf2, Hz", "A1/A0", "k_b, MN/m", "90 % interval", "valid")


def answer_row(answer: Answer) -> tuple[str, ...]:
    """An answer for a reader."""
    f, e = answer.features, answer.estimate
    return (
        answer.test,
        with_error(f.delta_f1, f.delta_f1_std),
        with_error(f.delta_f2, f.delta_f2_std),
        with_error(f.amplitude_ratio, f.amplitude_ratio_std),
        stiffness_with_error(e.k_b, e.k_b_std),
        interval(e.k_b_low, e.k_b_high),
        "yes" if e.valid else "no",
    )
