"""How well a change of the machine is found and named: ``python -m benchmarks.monitor [--page FILE]``; minutes.

The whole finite-element rotor, stepped four times as fast as the monitor, is the rig. Band noise or a multisine drives
node 2, where an accelerometer with 1 % of noise reads. GapMonitor.fmu, compiled, believes k_b to be 5 % too high; then
something changes.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.linalg import expm

from benchmarks.page import bar, machine, table
from benchmarks.tracker import FASTER, NODE, RIG, STEP, TRUE, band_noise, multisine
from rigtwin.estimator.tracking.monitor import CAUSES
from rigtwin.fmu_src.build import MONITOR, build_native_listener_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.effects import AttachedMass, DiskMass, PedestalFlexibility
from rigtwin.rotor.effects.effect import Effect
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.session import FmuSession

NOISE, LEARNED_S, HEARD_S = 0.01, 1.8, 0.5
STIFFNESSES = (1e6, 3e6, 1e7, 3e7)
STRUCTURE, FAST = assemble(RIG), STEP / FASTER
READ = f"node_{NODE}.acceleration_y"
ALARM_EVERY = 1e6  # the default is 1e9
PERIODS = 20.0  # of the first resonance within which a change of 1 % should be found
FIRST_SEED = 10  # the monitor was tuned on 0 to 3
LONG_S = 100.0  # of a machine that does not change

Strange = Callable[[float, FloatArray], FloatArray]


@dataclass(frozen=True)
class Change:
    """What happens to a machine."""

    cause: str
    words: str
    condition: Callable[[Condition], Condition] = lambda condition: condition
    effects: tuple[Effect, ...] = ()
    gain: float = 1.0
    strange: Strange | None = None  # forces at the nodes (n_nodes,) from time and deflections


def _at_node(node: int, law: Callable[[float, float], float]) -> Strange:
    def forces(t: float, q: FloatArray) -> FloatArray:
        F = np.zeros(len(q))
        F[node - 1] = law(t, q[node - 1])
        return F

    return forces


def _stiffer(share: float) -> Change:
    return Change("k_b", f"k_b {100 * share:+g} %", lambda c: replace(c, k_b=c.k_b * (1 + share)))


def _damped(factor: float) -> Change:
    words = f"bearings damp {factor:g} times as much"
    return Change("damping", words, lambda c: replace(c, bearing_damping=c.bearing_damping * factor))


def _heavier(kg: float, node: int) -> Change:
    return Change("mass", f"{1000 * kg:g} g at node {node}", effects=(AttachedMass(mass=kg, node=node),))


def _read(gain: float) -> Change:
    return Change("sensor", f"sensor reads {100 * (gain - 1):+g} %", gain=gain)


CHANGES = (
    *map(_stiffer, (-0.01, -0.05, -0.4)),
    *map(_damped, (1.5, 4.0)),
    Change("damping", "shaft damps twice as much", lambda c: replace(c, shaft_damping_ratio=2 * c.shaft_damping_ratio)),
    *(_heavier(kg, node) for kg, node in ((0.02, 4), (0.3, 5))),
    *map(_read, (1.03, 0.5)),
    Change("unknown", "rub at node 4", strange=_at_node(4, lambda t, x: -1e6 * max(x - 1e-6, 0.0))),
    Change("unknown", "sine of 73 Hz at node 6", strange=_at_node(6, lambda t, x: 0.3 * np.sin(2 * np.pi * 73 * t))),
)


@dataclass
class Machine:
    """The whole rotor in time."""

    condition: Condition
    effects: tuple[Effect, ...]
    strange: Strange | None = None
    x: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        system = build_system(STRUCTURE, self.condition, self.effects).in_plane(1)
        n, nodes = system.n, system.read_out(1)
        self._slow = 2 * np.pi * 500.0  # makes deflections as large as velocities
        rows = np.linalg.solve(system.M, np.column_stack([-system.K / self._slow, -system.C, nodes.T]))
        m = len(nodes)
        A = np.zeros((2 * n + 2 * m, 2 * n + 2 * m))
        A[:n, n : 2 * n] = self._slow * np.eye(n)
        A[n : 2 * n, : 2 * n + m] = rows
        A *= FAST
        A[2 * n : 2 * n + m, 2 * n + m :] = np.eye(m)
        E = expm(A)[: 2 * n]
        self._T, late = E[:, : 2 * n], E[:, 2 * n + m :]
        self._early, self._late, self._nodes = E[:, 2 * n : 2 * n + m] - late, late, nodes
        self._Y = nodes[NODE - 1] @ rows
        if not len(self.x):
            self.x = np.zeros(2 * n)

    def run(self, force: FloatArray, t: float) -> FloatArray:
        """Accelerations under a force (FASTER n + 1,), every FASTER-th value."""
        n = len(self._T)
        read = np.zeros(len(force) // FASTER)
        d, early, late = NODE - 1, self._early[:, NODE - 1], self._late[:, NODE - 1]
        for j in range(len(force) - 1):
            strange = self.strange(t + j * FAST, self._nodes @ self.x[: n // 2] / self._slow) if self.strange else None
            if j % FASTER == 0:
                read[j // FASTER] = self._Y[:n] @ self.x + self._Y[n + d] * force[j]
                read[j // FASTER] += 0.0 if strange is None else self._Y[n:] @ strange
            self.x = self._T @ self.x + early * force[j] + late * force[j + 1]
            if strange is not None:
                self.x = self.x + (self._early + self._late) @ strange
        return read


def main() -> None:
    """Measure, print, and write the page if one is asked for."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_native_listener_fmu(MONITOR, RIG, Path(folder), (NODE,), targets=[this_machine()])
        parts = [_changes(fmu), _nothing(fmu)]
    text = "\n\n".join([f"{__doc__.split(chr(10) * 2)[1]}\n\n{machine()}", *parts])
    print(text)
    if "--page" in sys.argv:
        target = Path(sys.argv[sys.argv.index("--page") + 1])
        target.write_text(f"# The monitor, measured\n\n{text}\n", encoding="utf-8")


def _changes(fmu: Path) -> str:
    found: list[tuple[Change, float, str, float]] = []
    for excitation in (band_noise, multisine):
        for place, k_b in enumerate(STIFFNESSES):
            found += watch(fmu, excitation, k_b, mass=(0.0, 0.03)[place % 2], seed=FIRST_SEED + place)
    rows = []
    for change in CHANGES:
        own = [each for each in found if each[0] is change]
        periods = np.array([each[1] for each in own])
        said = Counter(each[2] for each in own)
        wrong = ", ".join(sorted(set(said) - {change.cause}))
        seen = f"{np.median(periods):.2g}; {np.max(periods):.2g}"
        rows.append((change.words, seen, f"{said[change.cause]} of {len(own)}", wrong))
    share = {
        cause: float(np.mean([each[2] == cause for each in found if each[0].cause == cause])) for cause in CAUSES[1:]
    }
    small = [each[1] for each in found if each[0] is CHANGES[0]]
    k_b_off = [abs(each[3]) for each in found if each[0].cause == each[2] == "k_b"]
    named = f"named {1000 * HEARD_S:g} ms after it"
    bars = [
        bar("longest time until k_b - 1 % is found, in periods of the first resonance", max(small), at_most=PERIODS),
        *(bar(f"{cause}: share not {named}", 1 - share[cause], at_most=0.15) for cause in CAUSES[1:]),
        bar("largest error of a k_b that was named", max(k_b_off), at_most=0.005),
    ]
    header = ("what changes", "periods until the alarm: median; longest", named, "else said")
    intro = "Under band noise and a multisine, at k_b of 1, 3, 10 and 30 MN/m; disks as drawn or 3 % heavier."
    return "\n".join(["## Something changes\n", intro, "", table(header, rows), "", *bars])


def watch(fmu: Path, excitation: Callable, k_b: float, mass: float, seed: int) -> Iterable:
    """Each change, the periods until its alarm, what is said at the end, and the relative error of k_b then."""
    condition, base = replace(TRUE, k_b=k_b), (DiskMass(change=mass),) if mass else ()
    rng = np.random.default_rng(seed)
    before, after = round(LEARNED_S / STEP), round(HEARD_S / STEP)
    force = excitation((before + after) * FASTER + 1, rng)
    force *= np.minimum(np.arange(len(force)) * FAST / 0.02, 1.0)
    rig = Machine(condition, base)
    read = rig.run(force[: before * FASTER + 1], 0.0)
    noise = NOISE * read.std() * rng.standard_normal(before + after)
    f1 = elastic_frequencies_hz(build_system(STRUCTURE, condition), plane=1)[0]
    with FmuSession(fmu) as session:
        session.start(_believed(k_b))
        for i in range(before):
            said = _one(session, force[i * FASTER], read[i] + noise[i])
        assert not said[1], "an alarm before anything has changed"
        state = session.save_state()
        for change in CHANGES:
            session.restore_state(state)
            other = Machine(change.condition(condition), (*base, *change.effects), change.strange, rig.x.copy())
            late = change.gain * other.run(force[before * FASTER :], before * STEP)
            alarm = None
            for i in range(after):
                said = _one(session, force[(before + i) * FASTER], late[i] + noise[before + i])
                alarm = i + 1 if alarm is None and said[1] else alarm
            periods = np.inf if alarm is None else alarm * STEP * f1
            yield change, periods, CAUSES[int(said[2])], said[3] / other.condition.k_b - 1


def _believed(k_b: float) -> dict[str, float]:
    known = {"bearing_damping": 20.0, "shaft_damping_ratio": 0.005, "disk_mass_std": 0.05}
    return {"k_b": 1.05 * k_b, "alarm_every": ALARM_EVERY, **known}


def _one(session: FmuSession, force: float, read: float) -> list:
    session.set({"force": float(force), READ: float(read)})
    session.step(STEP)
    return session.get(("drift", "alarm", "cause", "k_b_found"))


def _nothing(fmu: Path) -> str:
    """A machine that stays as it is, and one whose pedestals the model does not have."""
    rows, spent = [], 0.0
    pedestals = (PedestalFlexibility(stiffness=1e8, mass=2.0, damping=100.0),)
    instants = round(LONG_S / STEP)
    for words, effects in (("as the model", ()), ("on pedestals of 100 MN/m", pedestals)):
        for excitation in (band_noise, multisine):
            rng = np.random.default_rng(7)
            force = excitation(instants * FASTER + 1, rng)
            read = Machine(replace(TRUE, k_b=3e6), effects).run(force, 0.0)
            read += NOISE * read.std() * rng.standard_normal(instants)
            with FmuSession(fmu) as session:
                session.start(_believed(3e6))
                alarm, most, start = None, 0.0, time.process_time()
                for i in range(instants):
                    said = _one(session, force[i * FASTER], read[i])
                    most = max(most, said[0])
                    if said[1]:
                        alarm = i
                        break
            spent = time.process_time() - start
            rows.append(
                (
                    words,
                    excitation.__name__.replace("_", " "),
                    f"{i + 1:,}",
                    "none" if alarm is None else f"{alarm:,}",
                    f"{most:.1f}",
                )
            )
    header = ("machine", "force", "steps", "alarm at step", "largest drift")
    took = f"A step took {1e6 * spent / (i + 1):.0f} µs with setting and reading the variables through fmpy."
    return "\n".join(["## Nothing changes\n", table(header, rows), "", took])


if __name__ == "__main__":
    main()
