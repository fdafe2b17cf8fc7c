"""Time stepping of the rotor with local nonlinear forces.

The rotor is x' = A x + B u - B_n F(C_n x) in the scaled modal state of ``state_space``, with F the forces
of the joints. Their slope at rest S is added to the linear part, so that a shaft in a gap moves freely,

    x' = A_t x + B u + G g,   g = F(d) - F(0) - S d,   d = C_n x,   A_t = A + G S C_n,   G = -B_n.

Over a substep tau the linear part is exact, the tones included: they are states of the matrix
exponential, set to the drive's exact phases at the start of every communication step. Only g is
interpolated, by the cubic that has its values and rates g' at both ends. A substep has to find those
at its end,

    d_1 = d_free + P g_1 + P' g_1',   v_1 = v_free + Q g_1 + Q' g_1',   g_1 = g(d_1),   g_1' = dg/dd v_1.

This is solved by Newton's method joint after joint, repeated until no joint moves another.

Substeps are the communication step over a power of two. One is halved until at every joint

    e <= max(3e-5 g_s, 1e-7 v_s / 2 |Q|)    |v_1 - v_0| <= 0.4 v_s    |P dg/dd| <= 0.2

and doubled where twice its length should meet these bounds too. Here g_s and v_s are the largest g
and v of the joint in about the last ten periods of the slowest mode. e is the largest of three values:
the error of the cubic in the middle of the substep, where the law is evaluated once more; a thousandth
of tau |g_0' - m| + tau |g_1' - m| with the mean rate m, which detects a corner of the law; and the
change that a turning point within the substep may make in a law with memory. So g is accurate to 3e-5
of its scale, or so accurate that the motion of the joint is not affected; no contact is missed; and the
substep resolves the stiffness of the joint, which makes the small system a contraction with one solution.
A substep for which Newton's method does not converge is halved too. A substep is at most a 16th of the
period of a tone. NoBalanceError is raised where Newton's method fails even on the shortest substep, and
where a step takes millions of substeps.

The state vector is x, then, for every joint in y and in z: g, g', g_s, v_s, and the substep. Nothing
else decides the next step, so a run from a saved state repeats to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.sparse.csgraph import connected_components

from rigtwin.rotor.model.arrays import FloatArray, IntArray
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.printed_laws import SCALAR
from rigtwin.rotor.model.rotor_model import RotorModel
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.time.drive import Drive
from rigtwin.rotor.time.exciter import Course
from rigtwin.rotor.time.stepper import CACHE_SIZE, Block, add_tone

# Allowed error of a joint's force within a substep, relative to the scale of the force.
FORCE_ERROR = 3e-5

# Share of the change of a force's rate that counts as error, even if the cubic fits in the middle.
_BEND = 1e-3

# Change of a joint's velocity by an error of its force, relative to the velocity's scale, that can be neglected.
_UNNOTICED = 1e-7

# Change of a joint's velocity in a substep, relative to its scale: 16 substeps a period of a sine.
_VELOCITY_CHANGE = 0.4

# |P dg/dd|: the substep is at most 1.2 over the frequency of the joint's stiffness on the joint's mass.
_STIFFNESS = 0.2

# A substep that needs less than this share of its bounds is followed by one twice as long, which needs four times as
# much: all measures, the root of the cubic's error among them, grow with the square of the substep.
_EASY = 0.2

_PER_PERIOD = 16  # substeps a period of a tone, at least
_PERIODS_KEPT = 10  # of the slowest mode, after which scales have faded by e
_SUBSTEPS_BETWEEN = 256  # after so many substeps the scales fade

# First substep of a rotor at rest, over the shortest time constant; the shortest of all over the first.
_FIRST, _SHORTEST = 0.1, 1e-5

# A step that needs more substeps than this belongs to a motion that grows without limit.
_MOST_SUBSTEPS = 1 << 24

# Newton's method stops when the pulls are consistent to this share of the error that is allowed anyway.
_NEWTON_SHARE = 0.01
_NEWTON_RELATIVE = _NEWTON_SHARE * FORCE_ERROR
_NEWTON_STEPS = 12

# Velocity of a joint, relative to the rotor's motion, below which it is round-off.
_ROUND_OFF = 1e-9

# Displacements [m] at which a law is straight but for round-off, and at which a radial one has no direction.
_STRAIGHT = 1e-13
_CENTRE = 1e-15

# Rows of the joints' part of the state: g, g', g_s, v_s, substep.
_ROWS = 5


class NoBalanceError(ValueError):
    """No force of a joint was found that agrees with the motion of the rotor."""


class NonlinearStepper:
    """Steps the state of one rotor with local forces.

    Parameters
    ----------
    model : the supported rotor, n degrees of freedom, with one local force or more
    inputs : (n, n_inputs) where forces act
    read_out : (n_out, n) deflections whose accelerations are wanted
    spin_speed : Omega [rad/s]
    """

    def __init__(self, model: RotorModel, inputs: FloatArray, read_out: FloatArray, spin_speed: float = 0.0):
        self._space = space = StateSpace(model.system, spin_speed)
        self._forces = model.forces
        patterns = np.concatenate([force.patterns for force in model.forces])  # (J, n) y and z of every force
        tangents = np.concatenate([_tangents(force) for force in model.forces])
        G, C = -space.input(patterns.T), space.displacement(patterns)
        A, B = space.A + (G * tangents) @ C, space.input(inputs)
        self._rotor = _Matrices(A, B, G, C)
        velocity = space.velocity(read_out)
        self._output = velocity @ A  # (n_out, n) acceleration from x
        self.feedthrough = velocity @ B  # (n_out, n_inputs) acceleration per newton
        self._pull_out = velocity @ G  # (n_out, J)
        self._memory = np.repeat([force.law.memory for force in model.forces], 2)
        self._groups = _groups(self._rotor)
        self._links = _links(model.forces, self._groups)
        self._parts: dict[tuple[bool, ...], list[_Part]] = {}
        self._times = _times(model, max(float(np.linalg.norm(matrix)) for matrix in (space.A, A)))

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        return self._space.n_states + _ROWS * len(self._rotor.C)

    def state_of(self, q: FloatArray, velocity: FloatArray, memory: FloatArray | None = None) -> FloatArray:
        """State of deflections q [m] and velocities [m/s], each (n,).

        ``memory`` is what another stepper's ``memory_of`` gave; where it does not fit, because the
        laws with memory are others now, they start without force.
        """
        x = self._space.state_of(q, velocity)
        d, v = (self._rotor.C @ x).tolist(), (self._rotor.V @ x).tolist()
        carried = np.zeros(len(d))
        if memory is not None and len(memory) == self._memory.sum():
            carried[self._memory] = memory
        g, rate = [], []
        for j, joint in enumerate(_joints(self._forces, np.arange(len(d)))):
            g.append(joint.pull(d[j], d[j], carried[j], d[joint.partner])[0])
            ahead = d[j] + self._times.first * v[j]  # where a law with memory goes from here
            _, slope, across = joint.pull(ahead, d[j], g[j], d[joint.partner])
            rate.append(slope * v[j] + across * v[joint.partner])
        return np.concatenate([x, g, rate, np.abs(g), np.abs(v), np.zeros(len(d))])

    def motion_of(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) deflections [m] and (n,) velocities [m/s] of a state."""
        return self._space.motion_of(state[: self._space.n_states])

    def memory_of(self, state: FloatArray) -> FloatArray:
        """Forces [N] of the laws with memory, in y and z of every joint."""
        return self._joint_rows(state)[0, self._memory]

    def step(self, state: FloatArray, drive: Drive, h: float) -> FloatArray:
        """State after h seconds. Raises NoBalanceError; see the module.

        Parameters
        ----------
        state : (n_states,)
        drive : the forces during the step
        h : step [s]
        """
        after = state.copy()
        rows = self._joint_rows(after)
        for part in self._moving_parts(state, drive):
            run = _Run(part, state[part.places], rows[:, part.coordinates], drive, h)
            after[part.places], rows[:, part.coordinates] = run.finish()
        return after

    def acceleration(self, state: FloatArray, forces: FloatArray) -> FloatArray:
        """(n_out,) accelerations [m/s^2] at this state under these (n_inputs,) forces [N]."""
        x, g = state[: self._space.n_states], self._joint_rows(state)[0]
        return self._output.dot(x) + self.feedthrough.dot(forces) + self._pull_out.dot(g)

    def _joint_rows(self, state: FloatArray) -> FloatArray:
        """(5, J) view of the joints' part of a state."""
        return state[self._space.n_states :].reshape(_ROWS, -1)

    def _moving_parts(self, state: FloatArray, drive: Drive) -> list[_Part]:
        """The parts that move, or will; groups that a radial law joins make one part."""
        g = self._joint_rows(state)[0]
        moving = [
            bool(state[block.places].any() or g[coordinates].any() or block.reached_by(drive))
            for block, coordinates in self._groups
        ]
        for y, z, centred in self._links:
            moving[y] |= moving[z] and not centred
        key = tuple(moving)
        if key not in self._parts:
            self._parts[key] = self._divide(moving)
        return self._parts[key]

    def _divide(self, moving: list[bool]) -> list[_Part]:
        joined = np.eye(len(moving), dtype=bool)
        for y, z, _ in self._links:
            joined[y, z] = moving[y] and moving[z]
        n_parts, part = connected_components(joined, directed=False)
        members = [[k for k in range(len(moving)) if part[k] == p and moving[k]] for p in range(n_parts)]
        return [self._part(numbers) for numbers in members if numbers]

    def _part(self, numbers: list[int]) -> _Part:
        places = np.sort(np.concatenate([self._groups[k][0].places for k in numbers]))
        coordinates = np.sort(np.concatenate([self._groups[k][1] for k in numbers]))
        joints = _joints(self._forces, coordinates)
        return _Part(places, coordinates, self._rotor.of(places, coordinates), joints, self._times)


# -- the rotor and its joints --------------------------------------------------------------------


@dataclass(frozen=True)
class _Times:
    """What substeps and scales are measured by."""

    first: float  # a substep that is short for everything [s]
    shortest: float  # no substep is shorter than half of this [s]
    fading: float  # of the scales [1/s]


def _times(model: RotorModel, fastest: float) -> _Times:
    """Times of a rotor; fastest: a bound on its rates [1/s]."""
    modes = model.system.modes
    elastic = modes.omega[modes.elastic]
    slowest = float(elastic.min()) if len(elastic) else 0.0
    return _Times(_FIRST / fastest, _FIRST * _SHORTEST / fastest, slowest / (2 * math.pi * _PERIODS_KEPT))


@dataclass(frozen=True)
class _Matrices:
    """x' = A x + B u + G g, d = C x."""

    A: FloatArray  # (n, n)
    B: FloatArray  # (n, n_inputs)
    G: FloatArray  # (n, J)
    C: FloatArray  # (J, n)

    @cached_property
    def V(self) -> FloatArray:
        """(J, n) velocities of the joints."""
        return self.C @ self.A

    def of(self, places: IntArray, coordinates: IntArray) -> _Matrices:
        """Of some states and joints."""
        return _Matrices(
            self.A[np.ix_(places, places)],
            self.B[places],
            self.G[np.ix_(places, coordinates)],
            self.C[np.ix_(coordinates, places)],
        )


def _groups(rotor: _Matrices) -> list[tuple[Block, IntArray]]:
    """States that act on each other, by the linear rotor or by a joint, and the joints they move."""
    graph = rotor.A != 0
    for pull, displacement in zip(rotor.G.T, rotor.C, strict=True):
        graph |= np.outer(pull != 0, displacement != 0)
    n_groups, group = connected_components(graph, directed=False)
    places = [np.flatnonzero(group == g) for g in range(n_groups)]
    return [(Block(p, rotor.A[np.ix_(p, p)], rotor.B[p]), np.flatnonzero(rotor.C[:, p].any(axis=1))) for p in places]


def _links(forces: Sequence[LocalForce], groups: Sequence[tuple[Block, IntArray]]) -> list[tuple[int, int, bool]]:
    """Groups of y and of z that a radial law joins when both move; and whether motion in z alone leaves y at rest."""
    group_of = {int(j): number for number, (_, coordinates) in enumerate(groups) for j in coordinates}
    pairs = [(group_of.get(2 * k), group_of.get(2 * k + 1), f) for k, f in enumerate(forces) if f.law.radial]
    return [(y, z, not f.offset) for y, z, f in pairs if y is not None and z is not None and y != z]


def _tangents(force: LocalForce) -> FloatArray:
    """(2,) slope of a force at rest, in y and in z; a law with memory has none."""
    law, coefficients = SCALAR[force.law.name], force.coefficients
    if force.law.memory:
        return np.zeros(2)
    pull, slope = law(force.offset, *coefficients)
    if force.law.radial and force.offset:
        return np.array([slope, pull / force.offset])
    return np.array([slope, law(0.0, *coefficients)[1]])


# Pull [N] and its slopes [N/m] by the own and by the partner's displacement, less the linear part, in Python floats:
# of the displacement [m], displacement and pull at the substep's start, and the partner's displacement.
_Pull = Callable[[float, float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class _Joint:
    """One joint in one plane, among the joints of a part."""

    name: str
    pull: _Pull
    partner: int  # the same joint in the other plane, where a radial law ties the two; else itself
    noise: float  # round-off of the pull [N]


def _joints(forces: Sequence[LocalForce], coordinates: IntArray) -> list[_Joint]:
    """Joints that move in these planes; coordinates: among y and z of every force in turn."""
    local = {int(j): number for number, j in enumerate(coordinates)}
    joints = []
    for j, number in local.items():
        force, plane = forces[j // 2], j % 2
        partner = local.get(j + 1 - 2 * plane, number) if force.law.radial else number
        if force.law.memory:
            pull = _with_memory(force)
        elif partner == number:
            pull = _alone(force, plane)
        else:
            pull = _radial(force, plane)
        joints.append(_Joint(f"{force.law.name} in {'yz'[plane]}", pull, partner, _noise(force, plane)))
    return joints


def _alone(force: LocalForce, plane: int) -> _Pull:
    """A law that acts in one plane by itself."""
    law, coefficients, tangent = SCALAR[force.law.name], force.coefficients, float(_tangents(force)[plane])
    offset = force.offset if plane == 0 else 0.0
    static = law(offset, *coefficients)[0]

    def pull(x: float, _: float, __: float, ___: float) -> tuple[float, float, float]:
        total, slope = law(x + offset, *coefficients)
        return total - static - tangent * x, slope - tangent, 0.0

    return pull


def _with_memory(force: LocalForce) -> _Pull:
    law, coefficients = SCALAR[force.law.name], force.coefficients

    def pull(x: float, x_before: float, g_before: float, _: float) -> tuple[float, float, float]:
        found = law(x, x_before, g_before, *coefficients)
        return found[0], found[1], 0.0

    return pull


def _radial(force: LocalForce, plane: int) -> _Pull:
    """A law along the resultant of two planes, as seen from one; the scalar form of ``LocalForce.across``."""
    law, coefficients, tangent = SCALAR[force.law.name], force.coefficients, float(_tangents(force)[plane])
    here, there = (force.offset, 0.0) if plane == 0 else (0.0, force.offset)
    static = law(here, *coefficients)[0]

    def pull(x: float, _: float, __: float, partner: float) -> tuple[float, float, float]:
        u, w = x + here, partner + there
        r = math.hypot(u, w)
        total, slope = law(r, *coefficients)
        if r < _CENTRE:
            return 0.0, slope - tangent, 0.0
        n, t, secant = u / r, w / r, total / r
        bend = slope - secant
        return total * n - static - tangent * x, secant + bend * n * n - tangent, bend * n * t

    return pull


def _noise(force: LocalForce, plane: int) -> float:
    """Round-off of a force [N], seen at displacements so small that the law is straight."""
    if force.law.memory:
        return 0.0
    pull, scatter = _alone(force, plane), []
    for x in np.linspace(-_STRAIGHT, _STRAIGHT, 16).tolist():
        g, slope, _ = pull(x, 0.0, 0.0, 0.0)
        scatter.append(abs(g - slope * x))
    return 4 * max(scatter)


# -- substeps ------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Instant:
    """The joints of a part at one instant; one entry per joint."""

    d: list[float]  # displacements [m]
    v: list[float]  # velocities [m/s]
    g: list[float]  # pulls [N]
    rate: list[float]  # their rates [N/s]
    stiffness: float = 0.0  # largest |P dg/dd|


@dataclass(slots=True)
class _Scales:
    """What errors are relative to; one entry per joint."""

    pull: list[float]  # [N]
    velocity: list[float]  # [m/s]

    def hold(self, now: _Instant) -> bool:
        """Take up the joints' pulls and velocities; whether that changes anything."""
        grown = False
        for j, (g, v) in enumerate(zip(now.g, now.v, strict=True)):
            if abs(g) > self.pull[j]:
                self.pull[j], grown = abs(g), True
            if abs(v) > self.velocity[j]:
                self.velocity[j], grown = abs(v), True
        return grown

    def fade(self, share: float, least_velocity: list[float]) -> None:
        """Forget all but a share."""
        self.pull = [share * pull for pull in self.pull]
        self.velocity = [max(share * v, least) for v, least in zip(self.velocity, least_velocity, strict=True)]


class _Response(NamedTuple):
    """A joint, and what the pulls u = (g, g') at a substep's end do to it there."""

    pull: _Pull
    partner: int
    P: float  # displacement by its own g [m/N]
    P_rate: float  # by its own g' [m s/N]
    Q: float  # velocity by its own g [m/s/N]
    Q_rate: float
    others: list[tuple[int, float, float]]  # entry of u, displacement and velocity by it


@dataclass(frozen=True)
class _Propagator:
    """One substep of a part."""

    tau: float  # [s]
    W: FloatArray  # from (x less the share of u, sources, u) to (the same at the end, d_free, v_free)
    onset: FloatArray  # (n, 2 J) share of x that comes from u at the substep's end
    joints: list[_Response]
    coupling: float  # displacement by the other joints' pulls over that by the own
    tied: bool  # whether a radial law ties two of the joints

    def bounds(self, scales: _Scales, joints: Sequence[_Joint]) -> list[float]:
        """Errors of the pulls [N] that are allowed."""
        notice = [_UNNOTICED / max(2 * abs(response.Q), 1e-300) for response in self.joints]
        quadruples = zip(joints, scales.pull, scales.velocity, notice, strict=True)
        return [max(FORCE_ERROR * g, notice * v, joint.noise) for joint, g, v, notice in quadruples]


# Tones by what their propagator depends on: omega, and the inputs they act on.
_Tones = tuple[tuple[float, tuple[int, ...]], ...]


class _Part:
    """States that are stepped together, with the joints they move."""

    def __init__(self, places: IntArray, coordinates: IntArray, rotor: _Matrices, joints: list[_Joint], times: _Times):
        self.places, self.coordinates = places, coordinates
        self.rotor, self.joints, self.times = rotor, joints, times
        self.velocity_round_off = _ROUND_OFF * np.linalg.norm(rotor.V, axis=1)
        self._reach = rotor.B.any(axis=0)
        self.propagator = lru_cache(maxsize=CACHE_SIZE)(partial(_propagator, rotor, joints))  # of tones and substep

    def sources(self, drive: Drive) -> tuple[_Tones, list[float]]:
        """The tones that this part hears; and the states that drive it: of every tone, then those of the signal."""
        tones, sources = [], []
        for tone in drive.tones:
            inputs = np.flatnonzero(self._reach & (tone.force != 0))
            if len(inputs):
                now = tone.force[inputs] * np.exp(1j * tone.start)  # forces Im now; a quarter of a period later Re now
                tones.append((tone.omega, tuple(inputs.tolist())))
                sources += [*now.imag.tolist(), *now.real.tolist()]
        return tuple(tones), [*sources, *drive.signal]


def _propagator(rotor: _Matrices, joints: list[_Joint], tones: _Tones, tau: float) -> _Propagator:
    """The substep tau of a part under these tones."""
    n, J = rotor.G.shape
    m = n + 2 * sum(len(inputs) for _, inputs in tones) + len(Course())
    exponential, powers = _exponential(rotor, tones, tau, m)
    one, theta, square, cube = powers  # what pulls of 1, s/tau, (s/tau)^2, (s/tau)^3 make of x
    start = np.hstack([one - 3 * square + 2 * cube, tau * (theta - 2 * square + cube)])
    onset = np.hstack([3 * square - 2 * cube, tau * (cube - square)])
    W = np.zeros((m + 2 * J, m + 2 * J))
    W[:m, :m] = exponential
    W[:n, m:] = exponential[:n, :n] @ onset + start
    W[m:] = np.vstack([rotor.C, rotor.V]) @ W[:n]
    P, Q = (rotor.C @ onset).tolist(), (rotor.V @ onset).tolist()
    responses, coupling = [], 0.0
    for j, joint in enumerate(joints):
        others = [(i, P[j][i], Q[j][i]) for i in range(2 * J) if i % J != j]
        responses.append(_Response(joint.pull, joint.partner, P[j][j], P[j][J + j], Q[j][j], Q[j][J + j], others))
        coupling = max(coupling, sum(abs(P[j][i]) for i in range(J) if i != j) / max(abs(P[j][j]), 1e-300))
    tied = any(joint.partner != j for j, joint in enumerate(joints))
    return _Propagator(tau, W, onset, responses, 1 + coupling if tied else coupling, tied)


def _exponential(rotor: _Matrices, tones: _Tones, tau: float, m: int) -> tuple[FloatArray, Sequence[FloatArray]]:
    """Rotor, tones and signal after tau; and (n, J) what pulls (s/tau)^k during it, k = 0 ... 3, make of x."""
    n, J = rotor.G.shape
    generator = np.zeros((m + 4 * J, m + 4 * J))
    signal = m - len(Course())
    generator[:n, :n], generator[:n, signal], generator[:n, m : m + J] = rotor.A, rotor.B[:, 0], rotor.G
    generator[signal, signal + 1] = generator[signal + 1, signal + 2] = 1.0  # force, rate, curvature
    first = n
    for omega, inputs in tones:
        add_tone(generator, first, omega, rotor.B[:, inputs])
        first += 2 * len(inputs)
    generator[m : m + 3 * J, m + J :] = np.eye(3 * J) / tau  # every power is the integral of the one before
    exponential = expm(tau * generator)
    powers = [math.factorial(k) * exponential[:n, m + k * J : m + (k + 1) * J] for k in range(4)]
    return exponential[:m, :m], powers


class _Run:
    """One communication step of a part, in 2^level substeps."""

    def __init__(self, part: _Part, x: FloatArray, rows: FloatArray, drive: Drive, h: float):
        self._part, self._h = part, h
        g, rate, pull_scale, velocity_scale, substeps = rows.tolist()
        self._now = _Instant(part.rotor.C.dot(x).tolist(), part.rotor.V.dot(x).tolist(), g, rate)
        self._scales = _Scales(pull_scale, velocity_scale)
        self._tones, sources = part.sources(drive)
        self._longest = (
            2 * math.pi / (_PER_PERIOD * max((abs(omega) for omega, _ in self._tones), default=0.0) or 1e-300)
        )
        self._place = self._level = 0
        if substeps:
            near = round(math.log2(h / (min(substeps) or part.times.first)))
            self._level = max(0, near, math.ceil(math.log2(h / self._longest)))
        self._p = part.propagator(self._tones, math.ldexp(h, -self._level))
        self._n, self._m = len(x), len(x) + len(sources)
        self._z = np.concatenate([x - self._p.onset.dot(g + rate), sources, g, rate])
        self._bounds = self._p.bounds(self._scales, part.joints)
        self._substeps, self._elapsed = 0, 0.0  # since the scales faded
        self._all_substeps = 0

    def finish(self) -> tuple[FloatArray, FloatArray]:
        """x and the joints' rows of the state at the end."""
        m, after, shortest = self._m, np.empty_like(self._z), self._part.times.shortest
        while self._place < 1 << self._level:
            p, old, scales = self._p, self._now, self._scales
            p.W.dot(self._z, out=after)
            new = _balance(p, old, after[m:].tolist(), self._bounds)
            severity = _severity(p, old, new, self._bounds, scales.velocity) if new else math.inf
            if severity > 1 and p.tau > shortest:
                self._change(1)
            elif new is None:
                raise self._no_balance("finds no balance with the rotor")
            elif self._all_substeps == _MOST_SUBSTEPS:
                raise self._no_balance("does not come to the end of the step")
            else:
                after[m:] = new.g + new.rate
                self._z, after = after, self._z
                self._accept(new)
                if severity < _EASY and self._level and not self._place & 1 and 2 * p.tau <= self._longest:
                    self._change(-1)
        x = self._z[: self._n] + self._p.onset.dot(self._z[m:])
        self._fade(x)
        now, scales = self._now, self._scales
        return x, np.array([now.g, now.rate, scales.pull, scales.velocity, [self._p.tau] * len(now.g)])

    def _no_balance(self, trouble: str) -> NoBalanceError:
        p, now = self._p, self._now
        worst = max(range(len(p.joints)), key=lambda j: abs(p.joints[j].P * now.rate[j]))
        return NoBalanceError(
            f"the local force {self._part.joints[worst].name} {trouble} at a displacement of {now.d[worst]:.3g} m, "
            f"even on a substep of {p.tau:.1g} s; check the effect's parameters and the force that drives the rotor"
        )

    def _accept(self, new: _Instant) -> None:
        self._now = new
        if self._scales.hold(new):
            self._bounds = self._p.bounds(self._scales, self._part.joints)
        self._place += 1
        self._substeps += 1
        self._all_substeps += 1
        self._elapsed += self._p.tau
        if self._substeps == _SUBSTEPS_BETWEEN:
            self._fade(self._z[: self._n])

    def _fade(self, x: FloatArray) -> None:
        share, size = math.exp(-self._elapsed * self._part.times.fading), math.sqrt(x.dot(x))
        self._scales.fade(share, (size * self._part.velocity_round_off).tolist())
        self._scales.hold(self._now)
        self._bounds = self._p.bounds(self._scales, self._part.joints)
        self._substeps, self._elapsed = 0, 0.0

    def _change(self, levels: int) -> None:
        """Go on with substeps of half (1) or twice (-1) the length."""
        self._level += levels
        self._place = 2 * self._place if levels > 0 else self._place // 2
        other = self._part.propagator(self._tones, math.ldexp(self._h, -self._level))
        self._z[: self._n] += (self._p.onset - other.onset).dot(self._z[self._m :])
        self._p = other
        self._bounds = self._p.bounds(self._scales, self._part.joints)


def _balance(p: _Propagator, old: _Instant, free: list[float], bounds: list[float]) -> _Instant | None:
    """The joints at a substep's end: d = d_free + P g(d) + P' g', joint after joint, until none moves another.

    None where Newton's method does not settle.

    Parameters
    ----------
    old : the joints at its start
    free : d_free, then v_free
    bounds : errors of the pulls that are allowed
    """
    J, tau = len(bounds), p.tau
    d_old, g_old, d, v = old.d, old.g, old.d[:], old.v[:]
    u = [g + tau * rate for g, rate in zip(g_old, old.rate, strict=True)] + old.rate  # a first guess
    try:
        for sweep in range(_NEWTON_STEPS):
            moved = stiffness = 0.0
            least = math.inf
            for j, (pull, partner, P, P_rate, Q, Q_rate, others) in enumerate(p.joints):
                x_free, v_free = free[j], free[J + j]
                for i, by, velocity_by in others:
                    x_free += by * u[i]
                    v_free += velocity_by * u[i]
                x = x_free + P * u[j] + P_rate * u[J + j]
                allowed = _NEWTON_SHARE * bounds[j]
                for _ in range(_NEWTON_STEPS):
                    g, slope, across = pull(x, d_old[j], g_old[j], d[partner])
                    rate = (slope * (v_free + Q * g) + across * v[partner]) / (1 - slope * Q_rate)
                    excess = x - x_free - P * g - P_rate * rate
                    miss = abs(slope * excess)
                    if miss <= allowed or miss <= _NEWTON_RELATIVE * abs(g):
                        break
                    x -= excess / (1 - slope * (P + P_rate * Q * slope))
                else:
                    return None
                stiffness = max(stiffness, abs(P * slope))
                least = min(least, max(allowed, _NEWTON_RELATIVE * abs(g)))
                if j:  # what the first one does, the others have seen
                    moved = max(moved, abs(g - u[j]) + tau * abs(rate - u[J + j]))
                d[j], v[j], u[j], u[J + j] = x, v_free + Q * g + Q_rate * rate, g, rate
            if moved * stiffness * p.coupling <= least and sweep >= p.tied:
                return _Instant(d, v, u[:J], u[J:], stiffness)
    except ArithmeticError:  # too large for a float, or a Jacobian without an inverse
        pass
    return None


def _severity(p: _Propagator, old: _Instant, new: _Instant, bounds: list[float], velocity_scale: list[float]) -> float:
    """Errors of a substep over their bounds."""
    tau, severity = p.tau, new.stiffness / _STIFFNESS
    d_0, d_1, v_0, v_1, g_0, g_1 = old.d, new.d, old.v, new.v, old.g, new.g
    middle = [0.5 * (d_0[j] + d_1[j]) + 0.125 * tau * (v_0[j] - v_1[j]) for j in range(len(d_0))]
    for j, (pull, partner, *_) in enumerate(p.joints):
        scale, start, g_start, v_start, v_end = velocity_scale[j], d_0[j], g_0[j], v_0[j], v_1[j]
        if not bounds[j]:  # from rest: there is nothing to compare with yet
            continue
        rise, rise_0, rise_1 = g_1[j] - g_start, tau * old.rate[j], tau * new.rate[j]
        g, _, _ = pull(middle[j], start, g_start, middle[partner])
        misfit = math.sqrt(abs(g - g_start - rise / 2 - (rise_0 - rise_1) / 8) / bounds[j])
        error = _BEND * (abs(rise_0 - rise) + abs(rise_1 - rise))
        swing = abs(v_end - v_start)
        if abs(v_start) < swing or abs(v_end) < swing:
            # The joint may have turned: try a path by way of the farthest turning point.
            reach = math.copysign(0.125 * tau * swing, v_start)
            turn = reach + (max(start, d_1[j]) if reach > 0 else min(start, d_1[j]))
            g_turn, _, _ = pull(turn, start, g_start, d_1[partner])
            error += abs(pull(d_1[j], turn, g_turn, d_1[partner])[0] - g_1[j])
        kick = (v_end - v_start) / (_VELOCITY_CHANGE * max(scale, abs(v_end))) if scale else 0.0
        severity = max(severity, misfit, error / bounds[j], kick * kick)
    return severity
