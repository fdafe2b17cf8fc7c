"""Bearing stiffness from measured runs, resonance lists or plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeGuard

from rigtwin.api.fmus import SHIPPED_RIG, open_estimator, trained_rig
from rigtwin.api.responses import fit_responses
from rigtwin.api.rigs import as_rig, refuse_tables
from rigtwin.api.workshop_errors import Asked, as_the_workshop_knows, workshop_error
from rigtwin.errors import UserError, existing, for_users
from rigtwin.estimator.features import FEATURE_NAMES, Features, features_of_peaks, features_of_runs
from rigtwin.estimator.intervals import BETWEEN_CODES, Z90
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import Estimate
from rigtwin.estimator.validity import objections
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model import html
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign import UNKNOWN_DAMPING, Campaign, MeasurementError, NominalBelief, Quantity, Run, SupportKind
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats import read_run_and_said
from rigtwin.sim.modal_fit import CoarseRasterError, fit_modes
from rigtwin.wording import interval, stiffness_with_error, with_error, yes_no

# A ratio read off a curve without an error of its own is trusted to this share.
RATIO_TRUST = 0.1

# A run whose first two resonances on rigid supports are further from a rig's than this share is of another rig: the
# paper's own are 6 % off, those of rotors of another size by far more.
_ANOTHER_RIG = 0.15

# Who answers: the trained network, root finding on the model by both shifts, or the model fitted to all lines.
Method = Literal["network", "model", "responses"]


@dataclass(frozen=True)
class Ratio:
    """An amplitude ratio that was given, where only resonances survive."""

    value: float
    std: float


@dataclass(frozen=True)
class Numbers:
    """Shifts and ratio that were given; what was not given is None."""

    delta_f1: float | None = None
    delta_f2: float | None = None
    amplitude_ratio: float | None = None
    delta_f1_std: float | None = None
    delta_f2_std: float | None = None
    amplitude_ratio_std: float | None = None


ANSWER_HEADER = ("test", "Δf1, Hz", "Δf2, Hz", "A1/A0", "k_b, MN/m", "90 % interval", "valid")


@dataclass(frozen=True)
class Answer:
    """One test and what is said about it."""

    test: str
    features: Features
    estimate: Estimate
    objections: list[str]  # why it is not valid
    method: Method = "network"
    workshop_error: float = math.nan  # standard error of ln k_b by what is usually off in a rig, where no campaign says

    def record(self) -> dict[str, Any]:
        """For a machine."""
        said = {"why_not_valid": self.objections, "method": self.method}
        if math.isfinite(self.workshop_error):
            said["workshop_error_of_ln_k_b"] = self.workshop_error
        return {"test": self.test, **asdict(self.features), **asdict(self.estimate), **said}

    def __str__(self) -> str:
        """Its stiffness in a line."""
        e = self.estimate
        told = f"k_b = {stiffness_with_error(e.k_b, e.k_b_std)} MN/m, 90 % interval {interval(e.k_b_low, e.k_b_high)}"
        return "; ".join([f"{self.test}: {told}", *(f"not valid: {words}" for words in self.objections)])

    def row(self) -> tuple[str, ...]:
        """For a reader, beneath ANSWER_HEADER."""
        f, e = self.features, self.estimate
        told = ((f.delta_f1, f.delta_f1_std), (f.delta_f2, f.delta_f2_std), (f.amplitude_ratio, f.amplitude_ratio_std))
        return (
            self.test,
            *(with_error(value, std) if math.isfinite(value) else "" for value, std in told),
            stiffness_with_error(e.k_b, e.k_b_std),
            interval(e.k_b_low, e.k_b_high),
            yes_no(e.valid),
        )


@dataclass(frozen=True)
class Answers:
    """What is said about every test; a sequence of ``Answer``."""

    answers: tuple[Answer, ...]
    remarks: tuple[str, ...] = ()  # a sentence on each thing that was left out or assumed

    def __len__(self) -> int:
        return len(self.answers)

    def __getitem__(self, place: int) -> Answer:
        return self.answers[place]

    def __iter__(self) -> Iterator[Answer]:
        return iter(self.answers)

    @property
    def best(self) -> Answer:
        """The valid one with the smallest relative error, or the first where none is valid."""
        valid = [answer for answer in self.answers if answer.estimate.valid]
        return min(valid, key=lambda a: a.estimate.k_b_std / a.estimate.k_b) if valid else self.answers[0]

    @property
    def k_b(self) -> float:
        """Bearing stiffness of ``best`` [N/m]; not to be used where its estimate is not valid."""
        return self.best.estimate.k_b

    def __str__(self) -> str:
        """A line for each test, and what speaks against it."""
        return "\n".join(map(str, self))

    def _repr_html_(self) -> str:
        said = [*(f"{a.test}: not valid: {words}" for a in self for words in a.objections), *self.remarks]
        return html.table(ANSWER_HEADER, [a.row() for a in self]) + "".join(map(html.paragraph, said))


@for_users
def estimate(
    *sources: Run | Campaign | str | Path,
    rig: Rig | str | Path | None = None,
    estimator: str | Path | None = None,
    excitation_node: int | None = None,
    quantity: Quantity | None = None,
    method: Method | None = None,
    trust: bool = False,
    **numbers: float | None,
) -> Answers:
    """Bearing stiffness k_b from two measured runs, from a campaign, or from numbers.

    Of a campaign, which says how well its rig is known, the finite-element model is fitted to all lines of each pair of
    runs, with the tolerances of the workshop, dampings, gains and drifts beside k_b. Of two runs or of numbers k_b is
    found by the two frequency shifts: by the shipped network for the rig it was trained for, on the model for another
    one. Where the lines are too few for shifts, all lines are fitted.

    Parameters
    ----------
    sources : a run on rigid supports and one on bearings, or a campaign (their files or folder, or as they were
        loaded), or nothing where ``numbers`` are given
    rig : that was measured, where the source does not say it; default the estimator's
    estimator : StiffnessEstimator.fmu, or an ONNX file of ``rigtwin train``; default the shipped network
    excitation_node, quantity : how the two runs were measured, where their files do not say it
    method : "network", "model" (by the shifts) or "responses" (by all lines); default as above
    trust : whether an FMU may run that this installation has not built; it runs with all your rights
    numbers : delta_f1, delta_f2 [Hz], amplitude_ratio [-], and delta_f1_std, delta_f2_std, amplitude_ratio_std

    Returns
    -------
    Answers, one for each pair of runs

    Raises
    ------
    UserError : nothing can be estimated from this

    >>> import rigtwin
    >>> found = rigtwin.estimate(
    ...     delta_f1=4.036, delta_f2=26.0, amplitude_ratio=1.228,
    ...     delta_f1_std=0.01, delta_f2_std=0.02, amplitude_ratio_std=0.01,
    ... )
    >>> print(found)
    numbers given: k_b = 9.9977 ± 0.0082 MN/m, 90 % interval 9.984 to 10.011
    >>> rigtwin.estimate()
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: nothing to estimate from: give RIGID_FILE BEARING_FILE, a campaign folder, or numbers
    """
    if unknown := set(numbers) - set(asdict(Numbers())):
        raise UserError(f"{min(unknown)}: there is no such number; there are {', '.join(asdict(Numbers()))}")
    settings = run_settings(excitation_node, quantity)
    chosen = Path(estimator) if estimator else None
    plain = [_plain(source) for source in sources]
    return answer_tests(plain, Numbers(**numbers), settings, chosen, rig, method=method, trust=trust)


def _plain(source: Run | Campaign | str | Path) -> Run | Campaign | Path:
    return source if isinstance(source, Run | Campaign) else Path(source)


def answer_tests(
    sources: Sequence[Run | Campaign | Path],
    numbers: Numbers,
    settings: dict[str, Any],
    estimator: Path | None,
    rig: Rig | str | Path | None = None,
    *,
    method: Method | None = None,
    trust: bool = False,
) -> Answers:
    """Answer every test that the arguments hold; see ``estimate``."""
    if len(sources) == 1 and isinstance(sources[0], Path) and not sources[0].is_file():
        sources = [load_campaign(sources[0])]
    known = rig if rig is not None else next((s.rig for s in sources if isinstance(s, Campaign)), None)
    for source in sources:
        if isinstance(source, Campaign):
            model = as_rig(known or source.rig)
            refuse_tables(model, "an estimate of k_b")
            source.check_nodes(len(model.nodes_m))
    if estimator and method not in (None, "network"):
        raise UserError(f"--estimator: the method {method} asks no network; leave one of the two out")
    if method == "responses":
        _refuse(numbers)
        return Answers((_by_responses(_all_runs(sources, settings, known)),))
    try:
        if method is None and not estimator and len(sources) == 1 and _has_runs(campaign := sources[0]):
            return _of_campaign(replace(campaign, rig=_named(rig or campaign.rig)), numbers, settings)
        with _asked(known, estimator, trust, method) as asked:
            tests, remarks = _tests(sources, numbers, settings, asked)
            if known is None and sources:
                _check_resonances(sources, settings, asked)
            belief = next((s.nominal for s in sources if isinstance(s, Campaign)), None)
            return Answers(tuple(asked.answer(test, belief) for test in tests), tuple(remarks))
    except CoarseRasterError as error:
        if method or estimator:
            raise
        answer = _by_responses(_all_runs(sources, settings, known))
        return Answers((answer,), (f"{error}; k_b is found by all lines together instead (--method responses)",))


def answers_of_runs(runs: Sequence[Run], rig: str, estimator: Path | None, *, trust: bool = False) -> Answers:
    """Answer every rigid and bearing pair among some runs."""
    with _asked(rig, estimator, trust) as asked:
        pairs, remarks = _pairs(runs, asked.node)
        return Answers(tuple(asked.answer(pair, None) for pair in pairs), tuple(remarks))


# -- who answers -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Test:
    """What is asked about: three numbers, and the two runs that they are of, if there are any."""

    name: str
    features: Features
    runs: tuple[Run, ...] = ()


@dataclass(frozen=True)
class _Asked:
    """Who answers, and what for."""

    name: Method
    rig: str
    node: int | None  # where the force has to act; None: anywhere
    model: Rig | None  # where its file is known
    ask: Asked

    @property
    def usual_node(self) -> int:
        """Where the force acts if neither files nor settings say it."""
        return self.model.excitation_node if self.model else self.node or Run.excitation_node

    def answer(self, test: _Test, belief: NominalBelief | None) -> Answer:
        """Of one test of a rig that is known as a campaign says, or of one that nobody says anything of."""
        if belief and self.model:
            found = as_the_workshop_knows(self.ask, self.model, belief, test.features)
            return Answer(test.name, test.features, *found, self.name)
        estimate, against = self.ask(test.features)
        beside = workshop_error(self.model, test.features, estimate.k_b) if self.model and estimate.valid else math.nan
        return Answer(test.name, test.features, estimate, against, self.name, beside)


@contextmanager
def _asked(
    rig: Rig | str | Path | None, estimator: Path | None, trust: bool, method: Method | None = None
) -> Iterator[_Asked]:
    """The network where it knows the rig, else root finding on the rig's model, or what is asked for.

    Raises UserError.
    """
    if method == "model":
        yield _by_model(as_rig(rig or SHIPPED_RIG))
        return
    with open_estimator(estimator, trust=trust) as (ask, card):
        trained = trained_rig(card)
        measured = trained if rig is None or rig == SHIPPED_RIG == trained else as_rig(rig).name
        if measured == trained:
            node = card.get("excitation_node", 2)
            model = as_rig(rig or trained) if rig or trained == SHIPPED_RIG else None
            yield _Asked("network", trained, node, model, lambda f: _with_objections(f, ask(f), card))
            return
    if estimator or method == "network":
        raise UserError(
            f"the campaign's rig is {measured}, the estimator was trained for {trained}; leave out --estimator "
            f"and --method to find k_b on the model of {measured}, or train one with rigtwin train --rig {rig}"
        )
    yield _by_model(as_rig(rig or measured))


def _with_objections(features: Features, estimate: Estimate, card: dict[str, Any]) -> tuple[Estimate, list[str]]:
    return estimate, objections(features, estimate, card)


def _by_model(rig: Rig) -> _Asked:
    refuse_tables(rig, "an estimate of k_b")
    damping = Condition(bearing_damping=rig.bearing_damping_Ns_per_m, shaft_damping_ratio=rig.shaft_damping_ratio)
    limits = rig.k_b.min_N_per_m, rig.k_b.max_N_per_m
    finder = StiffnessFinder(assemble(rig), damping, limits, rig.excitation_node)
    return _Asked("model", rig.name, None, rig, lambda f: (finder.estimate(f), finder.objections(f)))


def _has_runs(source: Run | Campaign | Path) -> TypeGuard[Campaign]:
    return isinstance(source, Campaign) and bool(source.runs)


def _of_campaign(campaign: Campaign, numbers: Numbers, settings: dict[str, Any]) -> Answers:
    """k_b of each pair of runs by all their lines, as the campaign says what the workshop knows of its rig."""
    _refuse(numbers)
    _refuse_settings(settings)
    pairs, remarks = _pairs(campaign.runs, None)
    told = [_by_responses(replace(campaign, runs=pair.runs), pair.features) for pair in pairs]
    return Answers(tuple(told), tuple(remarks))


def _by_responses(campaign: Campaign, features: Features | None = None) -> Answer:
    """k_b by all lines of a campaign's runs."""
    rig = as_rig(campaign.rig)
    refuse_tables(rig, "an estimate of k_b")
    limits = rig.k_b
    found = fit_responses(campaign)
    log_std = math.hypot(found.log_std, BETWEEN_CODES)
    low, high = (found.k_b * math.exp(z * log_std) for z in (-Z90, Z90))
    against = []
    if not found.explained:
        against.append(
            f"the model leaves {math.sqrt(found.misfit):.3g} times the noise, or takes tolerances that are not "
            "plausible: the rig differs from its model; rigtwin diagnose says where"
        )
    for key, size in found.unusual.items():
        against.append(
            f"the runs tell a {key} of {100 * size:.2g} %, far more than usual: it may stand in for what the model "
            f"lacks; say {key} in [nominal] if you know it, and ask rigtwin diagnose"
        )
    if not limits.min_N_per_m < found.k_b < limits.max_N_per_m:
        against.append(f"k_b = {found.k_b:.4g} N/m is at the end of the range that the rig file gives")
    estimate = Estimate(found.k_b, found.k_b * log_std, low, high, valid=not against)
    features = features or Features(*[math.nan] * len(FEATURE_NAMES))
    return Answer(" / ".join(run.name for run in campaign.runs), features, estimate, against, "responses")


def _all_runs(
    sources: Sequence[Run | Campaign | Path], settings: dict[str, Any], rig: Rig | str | Path | None
) -> Campaign:
    """The campaign's runs of the standing rotor, or the two runs as one, of a rig that nobody states dampings of."""
    if len(sources) == 1 and isinstance(campaign := sources[0], Campaign):
        _refuse_settings(settings)
        standing = tuple(run for run in campaign.runs if run.spin_rpm == 0)
        return replace(campaign, runs=standing, rig=_named(rig or campaign.rig))
    if len(sources) != 2:
        raise UserError("give a rigid and a bearing run, or one campaign folder: k_b is looked for in all their lines")
    belief = NominalBelief(shaft_damping_tolerance=UNKNOWN_DAMPING, bearing_damping_tolerance=UNKNOWN_DAMPING)
    named = _named(rig or SHIPPED_RIG)
    runs = _read_pair(sources, settings, as_rig(named).excitation_node)
    return Campaign("two runs", named, tuple(runs), nominal=belief)


def _named(rig: Rig | str | Path) -> str:
    if isinstance(rig, Rig):
        raise UserError("give the rig by its name or its file: all lines together are fitted to what a file says")
    return str(rig)


def _check_resonances(sources: Sequence[Run | Campaign | Path], settings: dict[str, Any], asked: _Asked) -> None:
    """Refuse files of another rig than the shipped network's: its resonances on rigid supports are elsewhere."""
    if asked.rig != SHIPPED_RIG:
        return
    shipped = as_rig(SHIPPED_RIG)
    rigid, _ = _read_pair(sources, settings, shipped.excitation_node)
    structure = assemble(shipped)
    expected = natural_frequencies_hz(build_system(structure, Condition(rigid_support=True)), plane=1)[:2]
    found = [mode.frequency_hz for mode in fit_modes(rigid, 2)]
    if max(abs(f / e - 1) for f, e in zip(found, expected, strict=True)) > _ANOTHER_RIG:
        raise UserError(
            f"run {rigid.name!r} on rigid supports has its resonances at {found[0]:.1f} and {found[1]:.1f} Hz, the rig "
            f"{SHIPPED_RIG} at {expected[0]:.1f} and {expected[1]:.1f} Hz: it is another rig; give its file with --rig"
        )


# -- what is asked ---------------------------------------------------------------------------------------


def _tests(
    sources: Sequence[Run | Campaign | Path], numbers: Numbers, settings: dict[str, Any], asked: _Asked
) -> tuple[list[_Test], list[str]]:
    """The tests, and what was left out or assumed."""
    if len(sources) == 2:
        _refuse(numbers)
        return _pairs(_read_pair(sources, settings, asked.usual_node), asked.node)
    if len(sources) == 1:
        campaign = sources[0]
        if not isinstance(campaign, Campaign):
            name = campaign.name if isinstance(campaign, Run) else campaign
            raise UserError(f"{name}: one file alone; give two, first the run on rigid supports, then that on bearings")
        _refuse_settings(settings)
        return _campaign_tests(campaign, numbers, asked)
    if sources:
        raise UserError(f"{len(sources)} files given; give a rigid and a bearing run, or one campaign folder")
    return [_Test("numbers given", _features(numbers, asked))], []


def _refuse(numbers: Numbers, allowed: Sequence[str] = ()) -> None:
    """What files say is not said again in numbers, but for what they cannot say."""
    given = [option(name) for name, value in asdict(numbers).items() if value is not None and name not in allowed]
    if given:
        raise UserError(f"{', '.join(given)}: numbers go without files that tell them; give either")


def _refuse_settings(settings: dict[str, Any]) -> None:
    if settings:
        raise UserError(f"{option(min(settings))}: the campaign says that of its runs; change its campaign.toml")


def _read_pair(sources: Sequence[Run | Campaign | Path], settings: dict[str, Any], node: int) -> list[Run]:
    """The two runs; the force is at ``node`` where neither files nor settings say it."""
    supports: tuple[SupportKind, SupportKind] = ("rigid", "bearing")
    for source in sources:
        if isinstance(source, Campaign) or (isinstance(source, Path) and source.is_dir()):
            name = source.title if isinstance(source, Campaign) else source
            raise UserError(f"{name}: a folder; give two run files, or one campaign folder alone")
    return [_read(source, support, settings, node) for source, support in zip(sources, supports, strict=True)]


def _read(source: Run | Campaign | Path, support: SupportKind, settings: dict[str, Any], node: int) -> Run:
    """A run on this support; one that says another support is refused, for the two may be mixed up."""
    if isinstance(source, Run):
        run = replace(source, **settings)
    else:
        path = existing(Path(str(source)))
        run, _ = read_run_and_said(path, node, support, **settings)  # no CSV says its support
    if run.support != support:
        name = source.name if isinstance(source, Run) else source
        raise UserError(
            f"{name}: a run on {run.support} support; give first the run on rigid supports, then that on bearings"
        )
    return run


def run_settings(excitation_node: int | None, quantity: Quantity | None) -> dict[str, Any]:
    """Settings of a run that were said."""
    said = {"excitation_node": excitation_node, "quantity": quantity}
    return {key: value for key, value in said.items() if value is not None}


def _campaign_tests(campaign: Campaign, numbers: Numbers, asked: _Asked) -> tuple[list[_Test], list[str]]:
    if campaign.runs:
        _refuse(numbers)
        return _pairs(campaign.runs, asked.node)
    _refuse(numbers, allowed=("amplitude_ratio", "amplitude_ratio_std"))
    ratio, remarks = _ratio(numbers, asked)
    return [_Test("resonance lists", features_of_campaign_peaks(campaign, ratio))], remarks


def features_of_campaign_peaks(campaign: Campaign, ratio: Ratio) -> Features:
    """Features of a campaign that holds resonance lists only. Raises UserError where a support is missing."""
    lists = {peaks.support: peaks for peaks in campaign.peaks}
    if set(lists) != {"rigid", "bearing"} or len(campaign.peaks) != 2:
        raise UserError(
            f"campaign {campaign.title!r}: one [[peaks]] of each support, rigid and bearing, is needed; "
            f"it has {len(campaign.peaks)}"
        )
    return features_of_peaks(lists["rigid"], lists["bearing"], ratio.value, ratio.std)


def _ratio(numbers: Numbers, asked: _Asked) -> tuple[Ratio, list[str]]:
    """The amplitude ratio, and what is assumed of its error; the model needs none."""
    if numbers.amplitude_ratio is None and asked.name == "model":
        return Ratio(math.nan, math.nan), []
    if numbers.amplitude_ratio is None:
        raise UserError(
            "resonance lists say nothing about amplitudes; give --amplitude-ratio A1/A0 (bearing over rigid support) "
            "and --amplitude-ratio-std"
        )
    std, remarks = numbers.amplitude_ratio_std, []
    if std is None:
        std = RATIO_TRUST * numbers.amplitude_ratio
        remarks = [f"--amplitude-ratio-std is not given; {100 * RATIO_TRUST:g} % of the ratio is taken"]
    ratio = Ratio(_finite("--amplitude-ratio", numbers.amplitude_ratio), _finite("--amplitude-ratio-std", std))
    return ratio, remarks


def _features(numbers: Numbers, asked: _Asked) -> Features:
    given = asdict(numbers)
    if all(value is None for value in given.values()):
        raise UserError("nothing to estimate from: give RIGID_FILE BEARING_FILE, a campaign folder, or numbers")
    if asked.name == "model":
        given |= {name: math.nan for name in ("amplitude_ratio", "amplitude_ratio_std") if given[name] is None}
    missing = [option(name) for name, value in given.items() if value is None]
    if missing:
        needed = (
            "both shifts and their standard errors"
            if asked.name == "model"
            else "shifts, ratio and all three standard errors"
        )
        raise UserError(f"{', '.join(missing)} missing; {needed} are needed")
    said = {name for name, value in asdict(numbers).items() if value is not None}
    for name, value in given.items():
        if name in said and _finite(option(name), value) < 0 and name.endswith("_std"):
            raise UserError(f"{option(name)} {value}: a standard error is 0 or more")
    return Features(**given)


def option(name: str) -> str:
    """'--delta-f1-std' of 'delta_f1_std'."""
    return "--" + name.replace("_", "-")


def _finite(what: str, value: float) -> float:
    if not math.isfinite(value):
        raise UserError(f"{what} {value}: give a finite number")
    return value


def _pairs(runs: Sequence[Run], node: int | None) -> tuple[list[_Test], list[str]]:
    """Each bearing run with the rigid run of the same exciter place; standing rotor only.

    Of runs whose response is not per force, that is of the same force as well. A pair that cannot be used is told, as
    long as another can. Raises MeasurementError where there is none, or the exciter stood elsewhere than it has to.
    """
    usable = [run for run in runs if run.spin_rpm == 0 and node in (None, run.excitation_node)]
    rigid = {_alike(run): run for run in reversed(usable) if run.support == "rigid"}
    pairs = [(rigid[_alike(run)], run) for run in usable if run.support == "bearing" and _alike(run) in rigid]
    if not pairs:
        place = "one node" if node is None else f"node {node}"
        raise MeasurementError(
            f"no rigid and bearing run of the standing rotor with the force at {place} in the same plane; "
            f"the estimator needs both; there are: {'; '.join(map(_describe, runs))}"
        )
    found, refused = [], []
    for first, second in pairs:
        try:
            features = features_of_runs(first, second)
            found.append(_Test(f"{first.name} / {second.name}", features, (first, second)))
        except MeasurementError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    return found, [f"left out: {error}" for error in refused]


def _alike(run: Run) -> tuple[object, ...]:
    """What a rigid and a bearing run must have in common."""
    force = run.force_amplitude_N if run.quantity == "acceleration" else None
    return run.excitation_node, run.excitation_plane, run.quantity, force


def _describe(run: Run) -> str:
    force = f" at {run.force_amplitude_N:g} N" if run.quantity == "acceleration" and run.force_amplitude_N else ""
    place = f"node {run.excitation_node} {run.excitation_plane}"
    return f"{run.name} ({run.support}, {place}, {run.quantity}{force}, {run.spin_rpm:g} rpm)"
