"""Stepped-sine runs on the virtual rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from fmpy.model_description import ModelDescription

from rigtwin.api.fmus import Host, excitation_node, host_of, rotor_fmu
from rigtwin.api.rigs import as_effects
from rigtwin.api.runs import MODE_HEADER, Modes, mode_row
from rigtwin.api.values import as_kind
from rigtwin.errors import UserError, for_users
from rigtwin.estimator.dataset import noisy
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.whirl import RPM
from rigtwin.rotor.geometry.rig import Rig as RigFile
from rigtwin.rotor.model import html
from rigtwin.scale_out import executor
from rigtwin.sim.archive import describe
from rigtwin.sim.campaign import Plane, Run, SupportKind, SweepDirection
from rigtwin.sim.formats import write_run
from rigtwin.sim.modal_fit import ModalFitError, fit_modes
from rigtwin.sim.runs import sweep_all, sweep_one
from rigtwin.sim.session import kind_of
from rigtwin.sim.stepped_sine import Rig, Sweep, SweepPlan
from rigtwin.wording import close_to

# Given what is measured and of how many lines or runs it consists: a context whose value is told the count so far.
Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]

# Parameters of the FMU that have a keyword of their own: the run's record must say the same as the FMU does.
OWN_KEYWORDS = {
    "rigid_support": "support",
    "excitation_node": "excitation_node",
    "excitation_plane": "plane",
    "spin_speed": "spin_rpm",
    "force_amplitude": "force_N",
    "force_frequency": "f_min_hz and f_max_hz",
}

# Fewer lines show no resonance.
LEAST_LINES = 8


@dataclass(frozen=True)
class SweepRequest:
    """What is to be measured; a run for each force."""

    source: str | RigFile  # an FMU, a rig file, a shipped rig, or a rig
    support: SupportKind = "bearing"
    effects: tuple[Effect, ...] = ()
    parameters: Mapping[str, float | int | bool | str] = field(default_factory=dict)  # of the FMU; text is read
    plan: SweepPlan = field(default_factory=SweepPlan)
    levels: tuple[float, ...] = ()  # force amplitudes, a run each; none: the plan's alone [N]
    noise: float = 0.0  # of a line, relative
    seed: int = 0
    excitation_node: int | None = None  # default the FMU's own
    plane: Plane = "y"
    across: bool = False  # accelerometers in the other plane, too
    quantity: Literal["accelerance", "acceleration"] = "accelerance"
    spin_rpm: float = 0.0
    executor: str | None = None  # "dask://host:port"; default processes here
    trust: bool = False  # an FMU that was built elsewhere


@dataclass(frozen=True)
class Swept:
    """A run that was measured on the virtual rig."""

    sweep: Sweep
    rig: Rig  # how the FMU was set up
    source: str  # the FMU or the rig
    guid: str  # of the FMU
    modes: Modes
    why_no_modes: str = ""  # where none could be fitted

    @property
    def run(self) -> Run:
        """What was measured."""
        return self.sweep.run

    @property
    def remarks(self) -> list[str]:
        """A sentence on each line that is not as it should be."""
        return list(self.sweep.remarks)

    def save(self, path: str | Path) -> Path:
        """Write the run into a .csv, .uff, .unv, .h5 or .mat file. Raises UserError."""
        return _save(self.run, path)

    def _repr_html_(self) -> str:
        said = [*self.remarks[:3], *([f"no mode fitted: {self.why_no_modes}"] if self.why_no_modes else [])]
        rows = [(place, *mode_row(self.run, mode)) for place, mode in enumerate(self.modes, start=1)]
        table = html.table(MODE_HEADER, rows) if rows else ""
        return self.run._repr_html_() + table + "".join(map(html.paragraph, said))


@for_users
def _save(run: Run, path: str | Path) -> Path:
    write_run(run, Path(path))
    return Path(path)


@for_users
def sweep(
    source: RigFile | str | Path = "nit-rourkela",
    *,
    support: SupportKind = "bearing",
    k_b: float | None = None,
    effects: Sequence[Effect | str] = (),
    parameters: Mapping[str, float | int | bool] | None = None,
    f_min_hz: float = 20.0,
    f_max_hz: float = 400.0,
    lines: int = 201,
    force_N: float = 1.0,
    direction: SweepDirection = "up",
    excitation_node: int | None = None,
    plane: Plane = "y",
    spin_rpm: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    settle_time_s: float = SweepPlan.settle_time,
    trust: bool = False,
) -> Swept:
    """Measure a stepped-sine run on the virtual rig and fit its modes.

    Every line is measured after it has settled, and lines are added round each resonance.

    Parameters
    ----------
    source : a ``RotorRig.fmu``, a rig, its file, or the name of a shipped one
    support : "bearing", or "rigid" for pinned bearings
    k_b : stiffness of every bearing [N/m]; default the start value of the rig file
    effects : what the rotor or the measurement has and the nominal model lacks: ids, or what ``effect`` makes
    parameters : further parameters of the FMU, such as ``{"bearing_damping": 20.0}`` [SI units]
    f_min_hz, f_max_hz, lines : the band [Hz] and the number of evenly spaced lines, before others are added
    force_N : peak amplitude of the force
    direction : "up" or "down", which matters for nonlinear rotors
    excitation_node, plane : where the force acts, default the rig's node and "y"
    spin_rpm : spin speed [rev/min]
    noise, seed : of each sensor, relative to each line, and what it is drawn with
    settle_time_s : pause between two looks whether a line has settled
    trust : whether an FMU may run that this installation has not built; it runs with all your rights

    Returns
    -------
    Swept, with ``run`` and ``modes``

    Raises
    ------
    UserError : the source cannot be read or built, or something that was asked for is not possible

    >>> import rigtwin
    >>> swept = rigtwin.sweep(k_b=2e6, f_min_hz=80, f_max_hz=90, lines=16)
    >>> [round(mode.frequency_hz, 2) for mode in swept.modes]
    [84.06]
    """
    given = dict(parameters or {})
    for name in given:
        if name in OWN_KEYWORDS:
            raise UserError(f"parameters: {name}: use {OWN_KEYWORDS[name]} for this")
    if k_b is not None:
        given["k_b"] = k_b
    if lines < LEAST_LINES:
        raise UserError(f"lines = {lines}: at least {LEAST_LINES} are needed to find a resonance")
    plan = SweepPlan(
        f_min_hz=f_min_hz,
        f_max_hz=f_max_hz,
        n_lines=lines,
        force_amplitude=force_N,
        direction=direction,
        settle_time=settle_time_s,
    )
    request = SweepRequest(
        source=source if isinstance(source, RigFile) else str(source),
        support=support,
        effects=as_effects(effects),
        parameters=given,
        plan=plan,
        noise=noise,
        seed=seed,
        excitation_node=excitation_node,
        plane=plane,
        spin_rpm=spin_rpm,
        trust=trust,
    )
    ((_, swept),) = measure(request)
    return swept


def measure(
    request: SweepRequest, progress: Progress = lambda *_: nullcontext(lambda _: None)
) -> Iterator[tuple[int, Swept]]:
    """Measure a run for each force of a request.

    Parameters
    ----------
    progress : called with what is measured and how many lines or runs that are

    Yields
    ------
    each run's place among the forces and the run, as they are done

    Raises
    ------
    UserError, SetupError, RigError, FmuError, NotSettledError : something that was asked for is not possible
    """
    if request.executor and not str(request.source).lower().endswith(".fmu"):
        raise UserError(f"--executor: give an FMU that all workers see in place of the rig {request.source}")
    plan = noisy(request.plan, request.noise, request.seed) if request.noise else request.plan
    plans = [replace(plan, force_amplitude=level) for level in request.levels or (plan.force_amplitude,)]
    with ExitStack() as stack:
        fmu = stack.enter_context(rotor_fmu(request.source))
        description = describe(fmu)
        rig, guid = _rig(description, request), str(description.guid)
        _check_spin(description, request.spin_rpm)
        host = stack.enter_context(host_of(fmu, trust=request.trust))
        name = request.source.name if isinstance(request.source, RigFile) else request.source
        for place, result in _measure(host, fmu.resolve(), rig, plans, request.executor, progress):
            modes, why_none = _modes(result.run)
            yield place, Swept(result, rig, name, guid, modes, why_none)


def _measure(
    host: Host, fmu: Path, rig: Rig, plans: Sequence[SweepPlan], where: str | None, progress: Progress
) -> Iterator[tuple[int, Sweep]]:
    """A run for each plan, with its place, as it is done; several at once, one for each core, or on a cluster."""
    if len(plans) == 1 and not where:
        words = f"{rig.support} support, {plans[0].force_amplitude:g} N"
        with progress(words, rig.carry_out(plans[0]).n_lines) as count:
            yield 0, host(sweep_one, fmu, rig, plans[0], progress=count)
        return
    with executor(where) as pool, progress(f"{rig.support} support, runs", len(plans)) as count:
        runs = sweep_all(fmu, [(rig, plan) for plan in plans], pool)
        for number, done in enumerate(runs, start=1):
            count(number)
            yield done


def _check_spin(description: ModelDescription, spin_rpm: float) -> None:
    """Raises UserError for a spin that the FMU has not; supports with tables narrow its range."""
    (speed,) = (v for v in description.modelVariables if v.name == "spin_speed")
    low, high = (float(end) / RPM if end else None for end in (speed.min, speed.max))
    if low is not None and high is not None and not low <= spin_rpm <= high:
        raise UserError(
            f"spin_rpm = {spin_rpm:g}: this rotor has spin speeds from {low:.5g} to {high:.5g} rev/min; give one"
        )


def _rig(description: ModelDescription, request: SweepRequest) -> Rig:
    return Rig(
        support=request.support,
        excitation_node=request.excitation_node or excitation_node(description),
        excitation_plane=request.plane,
        spin_rpm=request.spin_rpm,
        parameters=_typed(description, request.parameters),
        effects=request.effects,
        quantity=request.quantity,
        sensor_planes=(request.plane, "z" if request.plane == "y" else "y") if request.across else (),
    )


def _typed(
    description: ModelDescription, given: Mapping[str, float | int | bool | str]
) -> dict[str, float | int | bool]:
    """Parameters, each of the type that its FMU variable has. Raises UserError."""
    variables = {v.name: v for v in description.modelVariables if v.causality in ("parameter", "input")}
    for name in given:
        if name not in variables:
            known = ", ".join(known for known in variables if "." not in known)
            guess = close_to(name, variables)
            raise UserError(f"{name}: the FMU has no parameter {name}; {guess}it has {known}, and those of its effects")
    return {name: as_kind(name, value, kind_of(variables[name])) for name, value in given.items()}


def _modes(run: Run) -> tuple[Modes, str]:
    """Fitted modes, or none and the reason."""
    try:
        return Modes(run, fit_modes(run), ()), ""
    except ModalFitError as error:
        return Modes(run, (), ()), str(error)
