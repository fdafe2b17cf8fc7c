"""The gates an FMU has to pass before it is released.

Whatever runs the FMU runs in a process of its own: an FMU that crashes or hangs fails its gate, and
the report is written all the same.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from rigtwin.api.fmus import ask, estimator_for, excitation_node, fmu_card, manifest, trained_rig
from rigtwin.api.junit import Gate, Outcome, write_junit
from rigtwin.errors import UserError, for_users
from rigtwin.estimator.dataset import FEATURE_PLAN
from rigtwin.estimator.features import features_of_runs
from rigtwin.estimator.validity import objections
from rigtwin.rotor.model import html
from rigtwin.scratch import scratch_folder
from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.session import FmuError, FmuSession
from rigtwin.sim.stepped_sine import NotSettledError, Rig, sweep
from rigtwin.wording import percent, stiffness
from rigtwin.workers import Pool, worker_pool

ROTOR = "RotorRig"

# What sets each kind of FMU in motion; other FMUs are stepped with their start values.
_DRIVE = {"force_amplitude": 1.0, "force_frequency": 90.0}
_SAMPLES = 25

# Seconds for another program to start, which are none of the FMU's.
_STARTS_WITHIN = 30.0


@dataclass(frozen=True)
class Checked:
    """An FMU and what each gate said about it."""

    fmu: Path
    gates: tuple[Gate, ...]

    @property
    def passed(self) -> bool:
        """Whether no gate failed; one that could not be run does not count."""
        return not any(gate.outcome == "failed" for gate in self.gates)

    def save_junit(self, path: str | Path) -> Path:
        """Write a JUnit report, and return its path."""
        write_junit(self.fmu, list(self.gates), Path(path))
        return Path(path)

    def _repr_html_(self) -> str:
        return html.table(("gate", "outcome", "message"), [(g.name, g.outcome, g.message) for g in self.gates])


@for_users
def check_fmu(
    fmu: str | Path,
    *,
    expect_k_b: float | None = None,
    tolerance: float = 0.05,
    estimator: str | Path | None = None,
    time_limit_s: float = 600.0,
) -> Checked:
    """Whether an FMU complies with the standard, runs, replays, refuses bad values and gives back a known stiffness.

    The FMU runs in another process, which imports this script: a script needs ``if __name__ == "__main__":``.

    Parameters
    ----------
    fmu : for co-simulation, FMI 2.0 or 3.0
    expect_k_b : set a rotor FMU to this stiffness [N/m], measure it, and compare the estimate
    tolerance : largest relative error of that estimate
    estimator : estimator FMU; default the one beside the rotor FMU or in dist/, or else the shipped one
    time_limit_s : after which a gate fails

    Raises
    ------
    UserError : the file is no FMU, or no estimator goes with it

    >>> import rigtwin
    >>> rigtwin.check_fmu("missing.fmu")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: missing.fmu: no such file; check its name and folder
    """
    for name, value in (("--expect-k-b", expect_k_b), ("--tolerance", tolerance), ("--time-limit", time_limit_s)):
        if value is not None and not 0 < value < float("inf"):
            raise UserError(f"{name} {value}: give a positive number")
    chosen = Path(estimator) if estimator else None
    expectation = None if expect_k_b is None else Expectation(expect_k_b, tolerance, chosen)
    return Checked(Path(fmu), tuple(run_gates(Path(fmu), expectation, time_limit_s)))


class GateError(Exception):
    """A gate failed; the message says how."""


class NotRun(Exception):  # noqa: N818 - an outcome, not an error
    """A gate cannot be run here; the message says why."""


@dataclass(frozen=True)
class Expectation:
    """The stiffness a rotor FMU is set to and has to give back."""

    k_b: float  # [N/m]
    tolerance: float  # relative
    estimator: Path | None = None


def run_gates(fmu: Path, expectation: Expectation | None, time_limit: float) -> list[Gate]:
    """Run every gate, for ``time_limit`` [s] at most each.

    Raises
    ------
    UserError : the file is no FMU, or the expectation does not go with it
    """
    manifest(fmu)
    gates = [
        _gate("model description and archive (fmpy)", lambda: validate(fmu)),
        _gate("FMU Manipulation Toolbox -check", lambda: fmutool(fmu, time_limit)),
    ]
    with scratch_folder("check_") as folder, _Apart(time_limit) as apart:
        if expectation:
            expectation = _with_estimator(fmu, expectation, folder)
        gates += [
            _gate("loads, initialises, steps", lambda: apart(steps, fmu)),
            _gate("a saved state replays exactly", lambda: apart(replays, fmu)),
            _gate("a bad value is refused with a message", lambda: apart(refuses, fmu)),
        ]
        if expectation:
            name = f"the virtual rig gives back k_b = {expectation.k_b:g} N/m"
            gates.append(_gate(name, lambda: apart(gives_back, fmu, expectation)))
    return gates


def _gate(name: str, run: Callable[[], str]) -> Gate:
    begin = time.monotonic()
    outcome: Outcome = "passed"
    try:
        message = run()
    except GateError as error:
        outcome, message = "failed", str(error)
    except NotRun as reason:
        outcome, message = "not run", str(reason)
    return Gate(name, outcome, message, time.monotonic() - begin)


class _Apart:
    """A process to run gates in; where an FMU crashes or hangs it, the gate fails and the next gets a new one."""

    def __init__(self, time_limit: float) -> None:
        self._time_limit = time_limit
        self._pool: Pool | None = None
        self._open = ExitStack()

    def __enter__(self) -> _Apart:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool:
            self._end(self._pool)

    def __call__(self, run: Callable[..., str], *arguments: object) -> str:
        if self._pool is None:
            self._pool = self._open.enter_context(worker_pool(1))
            self._pool.run(_be_ready)
        try:
            return self._pool.submit(run, *arguments).result(self._time_limit)
        except BrokenExecutor:
            self._end(self._pool)
            raise GateError("the FMU crashed the process that ran it") from None
        except TimeoutError:
            self._end(self._pool)
            raise GateError(_too_slow(self._time_limit)) from None

    def _end(self, pool: Pool) -> None:
        self._pool = None
        pool.kill()
        self._open.close()


def _be_ready() -> None:
    """Nothing; a process that has found this function has imported all that a gate needs."""


def _too_slow(time_limit: float) -> str:
    return f"not done after {time_limit:g} s, stopped; --time-limit gives it longer"


def _with_estimator(fmu: Path, expectation: Expectation, folder: Path) -> Expectation:
    """The expectation with the estimator FMU to ask. Raises UserError where none fits."""
    if "rig" not in manifest(fmu):
        raise UserError(f"{fmu}: --expect-k-b needs a RotorRig.fmu of rigtwin build; leave it out to check other FMUs")
    found = estimator_for(fmu, expectation.estimator, folder)
    trained, built = trained_rig(fmu_card(found)), manifest(fmu)["rig"]
    if trained != built:
        raise UserError(f"{found} was trained for the rig {trained}, {fmu} is of {built}; give another --estimator")
    return replace(expectation, estimator=found)


# -- the gates -----------------------------------------------------------------------------------


def validate(fmu: Path) -> str:
    """Archive, XML schema and the standard's rules, as fmpy sees them."""
    from fmpy.validation import validate_fmu

    try:
        problems = validate_fmu(str(fmu))
    except Exception as error:  # fmpy raises bare Exception for XML it cannot read
        problems = [str(error)]
    if problems:
        raise GateError("; ".join(problems))
    return "no problems"


def fmutool(fmu: Path, time_limit: float) -> str:
    """The FMU Manipulation Toolbox's own check, where it is installed; for ``time_limit`` [s] at most."""
    if find_spec("fmu_manipulation_toolbox") is None:
        raise NotRun("fmu-manipulation-toolbox is not installed; pip install fmu-manipulation-toolbox")
    command = [sys.executable, "-m", "fmu_manipulation_toolbox", "-input", str(fmu), "-check"]
    with scratch_folder("fmutool_") as folder:
        own = {"env": os.environ | {"TMPDIR": str(folder)}, "timeout": time_limit + _STARTS_WITHIN}
        try:
            finished = subprocess.run(command, capture_output=True, check=False, **own)
        except subprocess.TimeoutExpired:
            raise GateError(_too_slow(time_limit)) from None
    lines = (finished.stdout + finished.stderr).decode(errors="replace").splitlines()
    problems = [line for line in lines if line.startswith(("ERROR", "CRITICAL", "FATAL"))]
    if finished.returncode or problems:
        raise GateError("; ".join(problems) or f"fmutool stopped with exit code {finished.returncode}")
    return "no problems"


def steps(fmu: Path) -> str:
    """Every Real output stays finite; a rotor under force moves."""
    with _open(fmu) as session:
        values = _record(session)
        name = session.description.modelName
    if not np.isfinite(values).all():
        raise GateError("an output is not a finite number")
    if name == ROTOR and not np.ptp(values, axis=0).any():
        raise GateError("a force of 1 N moves nothing")
    return f"{_SAMPLES} samples of {values.shape[1]} outputs, all finite"


def replays(fmu: Path) -> str:
    """From a restored state every output is the same to the last bit."""
    with _open(fmu) as session:
        interface = session.description.coSimulation
        if not (interface and interface.canGetAndSetFMUstate and interface.canSerializeFMUstate):
            raise NotRun("the FMU does not offer to save its state")
        _record(session)
        try:
            saved = session.save_state()
            first = _record(session)
            session.restore_state(saved)
            second = _record(session)
        except FmuError as error:
            raise GateError(str(error)) from error
    if not np.array_equal(first, second):
        raise GateError(f"after restoring, outputs differ by up to {np.max(np.abs(first - second)):.3g}")
    return f"{_SAMPLES} samples replayed to the last bit, {len(saved.content)} bytes of state"


def refuses(fmu: Path) -> str:
    """A value below a variable's own minimum is refused in words, and the FMU then still steps.

    FMI does not ask for it, rigtwin's own FMUs promise it.
    """
    if not manifest(fmu):
        raise NotRun("only FMUs that rigtwin built promise it")
    with _open(fmu) as session:
        settable = [
            v for v in session.description.modelVariables if v.causality == "input" or v.variability == "tunable"
        ]
        minima = [(v.name, float(v.min)) for v in settable if session.kind(v.name) == "Real" and v.min]
        if not minima:
            raise NotRun("no Real variable states a minimum")
        name, minimum = minima[0]
        bad = minimum - 1.0
        try:
            session.set({name: bad})
        except FmuError as error:
            if name not in str(error):
                raise GateError(f"{name} = {bad:.12g} is refused, but no message names it: {error}") from error
            _record(session)
            return f"{name} = {bad:.12g} is refused, its minimum is {minimum:g}"
    raise GateError(f"{name} = {bad:.12g} is accepted, its minimum is {minimum:g}")


def gives_back(fmu: Path, expectation: Expectation) -> str:
    """Both supports are measured with k_b set, the estimator says which k_b it was."""
    estimator = expectation.estimator
    assert estimator
    card = fmu_card(estimator)
    plan = FEATURE_PLAN
    if "band_hz" in card:
        plan = replace(plan, f_min_hz=card["band_hz"][0], f_max_hz=card["band_hz"][1])
    try:
        with FmuSession(fmu) as rig, FmuSession(estimator) as network:
            node, parameters = excitation_node(rig.description), {"k_b": expectation.k_b}
            rigid, bearing = (
                sweep(rig, Rig(support, node, parameters=parameters), plan).run for support in ("rigid", "bearing")
            )
            features = features_of_runs(rigid, bearing)
            estimate = ask(network, features)
    except (FmuError, MeasurementError, NotSettledError) as error:
        raise GateError(str(error)) from error
    reasons = objections(features, estimate, card)
    if reasons:
        raise GateError(f"the estimate {stiffness(estimate.k_b)} MN/m is not valid: {'; '.join(reasons)}")
    error = estimate.k_b / expectation.k_b - 1
    said = f"estimated {stiffness(estimate.k_b)} MN/m, {percent(error)} off, allowed {100 * expectation.tolerance:g} %"
    if not abs(error) <= expectation.tolerance:
        raise GateError(said)
    return said


@contextmanager
def _open(fmu: Path) -> Iterator[FmuSession]:
    """An FMU initialised and, if it is a rotor, under force. Raises GateError where that fails."""
    try:
        session = FmuSession(fmu)
    except Exception as error:  # fmpy raises bare Exception too
        raise GateError(f"it cannot be loaded: {error}") from error
    with session:
        try:
            session.start({name: value for name, value in _DRIVE.items() if name in session.variables})
        except FmuError as error:
            raise GateError(f"it cannot be initialised: {error}") from error
        yield session


def _record(session: FmuSession) -> np.ndarray:
    """(_SAMPLES, n) Real outputs over some steps. Raises GateError where the FMU fails."""
    variables, experiment = session.description.modelVariables, session.description.defaultExperiment
    outputs = [
        v.name for v in variables if v.causality == "output" and session.kind(v.name) == "Real" and not v.dimensions
    ]
    h = float(experiment.stepSize) if experiment and experiment.stepSize else 1e-3
    try:
        return session.sample(outputs, h, _SAMPLES)
    except FmuError as error:
        raise GateError(str(error)) from error
