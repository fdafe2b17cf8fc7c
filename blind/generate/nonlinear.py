"""Nonlinear rigs under a stepped sine: harmonic balance at the joints, followed upwards from line to line.

With X_k the harmonics of the joints' displacements, N_k those of their forces,
    X_k = G_jF(k w) F delta_k1 + G_jj(k w) (P delta_k0 - N_k),      x(t) = Re sum_k X_k e^{i k w t},
G from the eigenvectors of the linear machine. Newton's method starts from the line before; a step that leads far away
is halved, and where no solution continues the branch the motion falls onto whatever other branch is found.

A motion that is not stable is none that a lab could measure: a disturbance of it is carried over one period, and must
not have grown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.laws import Law, Memoryless, law_of
from rigtwin.blind.generate.lines import cluster, resonances
from rigtwin.blind.generate.machine import Machine, Setting, Workshop, build_machine
from rigtwin.blind.generate.response import N_DRIFTING, chain_factor
from rigtwin.blind.generate.rig import PLANS, REFERENCE, ComplexArray, FloatArray, Rig

HARMONICS = 17  # more than the diagnosis has
SAMPLES = 1024
FAR = 0.25  # relative change of the motion from one line to the next that counts as another branch
SMALLEST_STEP = 2e-3  # Hz, on the reference's band
STATIC_HZ = 2000.0  # modes above follow a disturbance at once; on the same band
PERIODS = 100  # that are stepped
REPEATS, SPREAD = 5, 2e-3  # over so many last periods the forces' fundamentals change by no more, in relation
UNFELT = 1e-6  # share of the exciter's force below which a joint's force need not repeat
GROWTH = 1.001  # of a disturbance over a period that is not taken for round-off
ALWAYS_STABLE = ("bearing_friction",)  # elements that only ever take energy from a disturbance
MOST_LEFT_OUT = 0.25  # of a run's lines
STEPPED = "stepped"  # the form of an effect that is solved in time


class NotFoundError(ArithmeticError):
    """Harmonic balance found no motion at a line, or none that is stable."""


@dataclass(frozen=True)
class Joints:
    """Nonlinear forces of a machine; nj joints."""

    rows: FloatArray  # (nj, n)
    laws: tuple[Law, ...]
    preloads: FloatArray  # (nj,) static load [N]
    gaps: FloatArray  # (nj,) way [m] that the preload takes the joint before it carries


def joints_of(machine: Machine, setting: Setting, effects: Sequence[Effect]) -> Joints:
    """Where forces act: at every bearing, or at the node of a rub."""
    rows, laws, preloads, gaps = [], [], [], []
    for effect in effects:
        if effect.id == "rub":
            rows.append(machine.read[(effect.node or 1) - 1])
            laws.append(law_of(effect, 0.0))
            preloads.append(0.0)
            gaps.append(0.0)
        elif effect.is_nonlinear and not setting.rigid:
            for bearing in machine.bearings:
                rows.append(bearing.row)
                laws.append(law_of(effect, bearing.stiffness))
                pressed = effect.id == "bearing_clearance"
                preloads.append(effect["preload"] if pressed else 0.0)
                gaps.append(effect["gap"] if pressed and effect["preload"] > 0 else 0.0)
    return Joints(np.array(rows).reshape(len(rows), len(machine.M)), tuple(laws), np.array(preloads), np.array(gaps))


class Poles:
    """Receptances of a machine as a sum over its eigenvectors."""

    def __init__(self, machine: Machine, drift: FloatArray) -> None:
        n = len(machine.M)
        K = machine.K + machine.stiffness_of_drift(drift)
        A = np.zeros((2 * n, 2 * n))
        A[:n, n:] = np.eye(n)
        A[n:] = -np.linalg.solve(machine.M, np.hstack([K, machine.C + machine.C_shaft]))
        self.values, self.V = np.linalg.eig(A)
        self.n = n
        self.W = np.linalg.solve(self.V, np.vstack([np.zeros((n, n)), np.linalg.inv(machine.M)]).astype(complex))

    def between(self, outputs: FloatArray, inputs: FloatArray, omega: FloatArray) -> ComplexArray:
        """(n_freq, n_out, n_in) displacement per force; rows of outputs and inputs are patterns (., n)."""
        left, right = outputs @ self.V[: self.n], self.W @ inputs.T
        return (left / (1j * omega[:, None, None] - self.values)) @ right


class Balance:
    """Harmonic balance of one machine under a force of one level."""

    def __init__(self, machine: Machine, joints: Joints, level: float, drift: FloatArray) -> None:
        self.poles = Poles(machine, drift)
        self.joints, self.level, self.drive = joints, level, machine.drive[None, :]
        self.machine = machine
        self.width = machine.band_hz[1] / PLANS[REFERENCE].band_hz[1]  # of the band, over the reference's
        t = 2 * np.pi * np.arange(SAMPLES)[:, None] / SAMPLES
        k = np.arange(1.0, HARMONICS + 1)
        self.gamma = np.hstack([np.ones_like(t), _interleaved(np.cos(k * t), -np.sin(k * t))])  # (N, nc)
        self.rate = np.hstack([np.zeros_like(t), _interleaved(-k * np.sin(k * t), -k * np.cos(k * t))])
        weight = np.array([1.0, *(2.0,) * (2 * HARMONICS)])
        self.gamma_plus = weight[:, None] * self.gamma.T / SAMPLES  # (nc, N)

    def linear_part(self, omega: float, extra: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """(nj nc,) motion without the laws and (nj nc, nj nc) receptance, coefficients (X0, Re X1, Im X1, ...).

        extra : linear stiffness [N/m] at every joint, for starts
        """
        nj, nc = len(self.joints.rows), 2 * HARMONICS + 1
        k = np.arange(HARMONICS + 1)
        G = self.poles.between(self.joints.rows, self.joints.rows, k * omega)  # (H + 1, nj, nj)
        g = self.level * self.poles.between(self.joints.rows, self.drive, np.array([omega]))[0, :, 0]
        A = np.zeros((nj, nc, nj, nc))
        A[:, 0, :, 0] = G[0].real
        re, im = 1 + 2 * (k[1:] - 1), 2 + 2 * (k[1:] - 1)
        parts = np.moveaxis(G[1:], 0, 1)  # (nj, H, nj)
        for h in range(HARMONICS):
            A[:, re[h], :, re[h]] = A[:, im[h], :, im[h]] = parts[:, h].real
            A[:, re[h], :, im[h]], A[:, im[h], :, re[h]] = -parts[:, h].imag, parts[:, h].imag
        static = G[0].real @ self.joints.preloads
        u = np.zeros((nj, nc))
        u[:, 0], u[:, 1], u[:, 2] = static, g.real, g.imag
        A2, u1 = A.reshape(nj * nc, nj * nc), u.ravel()
        if extra:
            return np.linalg.solve(np.eye(nj * nc) + extra * A2, u1), A2
        return u1, A2

    def forces(self, u: FloatArray, omega: float) -> tuple[FloatArray, FloatArray]:
        """(nj nc,) harmonics of the joints' forces and (nj nc, nj nc) their slopes."""
        nc = 2 * HARMONICS + 1
        n, dn = np.zeros_like(u), np.zeros((len(u), len(u)))
        for j, law in enumerate(self.joints.laws):
            where = slice(j * nc, (j + 1) * nc)
            force, slope = law(u[where], self.gamma, self.rate, omega)
            n[where], dn[where, where] = self.gamma_plus @ force, self.gamma_plus @ slope
        return n, dn

    def solve(self, omega: float, start: FloatArray, iterations: int = 25) -> FloatArray | None:
        """Newton's method from a start; nothing where it does not arrive."""
        u0, A = self.linear_part(omega)
        u = start
        n, dn = self.forces(u, omega)
        residual = u - u0 + A @ n
        for _ in range(iterations):
            size = np.abs(u).max()
            if np.abs(residual).max() < 1e-8 * size:
                return u
            step = -np.linalg.solve(np.eye(len(u)) + A @ dn, residual)
            for length in (1.0, 0.5, 0.25, 0.1, 0.03):
                trial = u + length * step
                n, dn_trial = self.forces(trial, omega)
                r = trial - u0 + A @ n
                if np.linalg.norm(r) < (1 - 0.3 * length) * np.linalg.norm(residual):
                    break
            else:
                if np.linalg.norm(r) > 10 * np.linalg.norm(residual):
                    return None
            u, residual, dn = trial, r, dn_trial
        return u if np.abs(residual).max() < 1e-5 * np.abs(u).max() else None

    def follow(self, omega: float, before: FloatArray, omega_before: float) -> FloatArray | None:
        """The motion at a line that continues the one at another; nothing where the branch ends between them."""
        here, u, step = omega_before, before, omega - omega_before
        while here != omega:
            there = omega if abs(step) >= abs(omega - here) else here + step
            new = self.solve(there, u)
            if new is not None and np.linalg.norm(new - u) < FAR * np.linalg.norm(new):
                here, u, step = there, new, 2 * step
            elif abs(step) > 2 * np.pi * SMALLEST_STEP * self.width:
                step /= 4
            else:
                return None
        return u

    def land(self, omega: float) -> FloatArray | None:
        """The motion where another branch has ended: the one that comes from above, where there is one motion only."""
        for above in (0.0, 0.01, 0.03, 0.06, 0.12, 0.25):
            start = omega * (1 + above)
            for extra in self.starts:
                linear = self.linear_part(start, extra)[0]
                linear[:: 2 * HARMONICS + 1] += self.joints.gaps
                u = self.solve(start, linear, 40)
                if u is not None:
                    u = self.follow(omega, u, start)
                    if u is not None:
                        return u
        return None

    @property
    def starts(self) -> tuple[float, ...]:
        """Linear stiffnesses [N/m] at the joints from whose motions Newton's method starts."""
        stiffness = max((b.stiffness for b in self.machine.bearings), default=1e6)
        return (0.0, -0.5 * stiffness, 0.5 * stiffness)

    def sweep(self, omega: FloatArray) -> FloatArray:
        """(n_freq, nj nc) motions of an upward sweep."""
        motions = []
        u = self.land(float(omega[0]))
        for k, w in enumerate(omega):
            if k and u is not None:
                u = self.follow(float(w), u, float(omega[k - 1]))
            if u is None:
                u = self.land(float(w))
            if u is None:
                raise NotFoundError(f"no periodic motion found at {w / 2 / np.pi:.3f} Hz and {self.level:g} N")
            motions.append(u)
        return np.array(motions)

    def reduced(self) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray]:
        """Eigenvalues (m,) up to ``STATIC_HZ``, how the joints load them (m, nj) and feel them (nj, m), and how the
        joints give way by all the others (nj, nj)."""
        kept = np.abs(self.poles.values) < 2 * np.pi * STATIC_HZ * self.width
        values, rows = self.poles.values[kept], self.joints.rows
        B = np.asarray(self.poles.W[kept] @ rows.T, dtype=complex)
        C = np.asarray(rows @ self.poles.V[: self.poles.n, kept], dtype=complex)
        D = (self.poles.between(rows, rows, np.zeros(1))[0] + (C / values) @ B).real
        return np.asarray(values, dtype=complex), B, C, np.asarray(D, dtype=float)

    def growth(self, omega: FloatArray, motions: FloatArray) -> FloatArray:
        """(n_freq,) factor by which a disturbance grows in a period at most: the largest Floquet multiplier.

        Between samples the eigenvectors' coordinates move by e^{lambda h}; at each sample the slopes S of the laws act
        as a kick -h B S dx on them, with dx = C z - D S dx and D what the modes above ``STATIC_HZ`` give way.
        """
        values, B, C, D = self.reduced()
        h = 2 * np.pi / omega / SAMPLES
        free = np.exp(values * h[:, None])[:, :, None]  # (n_freq, m, 1)
        slopes = self._slopes(omega, motions)  # (n_freq, nj, N)
        z = np.broadcast_to(np.eye(len(values), dtype=complex), (len(omega), len(values), len(values))).copy()
        for k in range(SAMPLES):
            S = slopes[:, :, k]
            gives = np.eye(len(D)) + D * S[:, None, :]
            dx = np.linalg.solve(gives.astype(complex), C @ z)
            z = free * (z - h[:, None, None] * (B @ (S[:, :, None] * dx)))
        return np.abs(np.linalg.eigvals(z)).max(axis=1)

    def _slopes(self, omega: FloatArray, motions: FloatArray) -> FloatArray:
        """(n_freq, nj, N) slope of each law without memory along its motion."""
        nc = 2 * HARMONICS + 1
        slopes = np.empty((len(omega), len(self.joints.laws), SAMPLES))
        for i, (u, w) in enumerate(zip(motions, omega, strict=True)):
            for j, law in enumerate(self.joints.laws):
                slopes[i, j] = law(u[j * nc : (j + 1) * nc], self.gamma, self.rate, float(w))[1][:, 0]
        return slopes

    def fundamentals(self, omega: FloatArray, motions: FloatArray) -> ComplexArray:
        """(n_freq, nj) first harmonic of the joints' forces."""
        nc = 2 * HARMONICS + 1
        N = np.array([self.forces(u, w)[0].reshape(-1, nc) for u, w in zip(motions, omega, strict=True)])
        return N[:, :, 1] + 1j * N[:, :, 2]

    def accelerance(self, omega: FloatArray, forces: ComplexArray) -> ComplexArray:
        """(n_freq, n_nodes) fundamental of the acceleration over the force; forces: ``fundamentals`` of the joints."""
        read = self.machine.read
        q = self.level * self.poles.between(read, self.drive, omega)[:, :, 0]
        q = q - np.einsum("foj,fj->fo", self.poles.between(read, self.joints.rows, omega), forces)
        return -(omega[:, None] ** 2) * q / self.level


def swept_up(
    rig: Rig,
    setting: Setting,
    effects: Sequence[Effect],
    frequency_hz: FloatArray,
    level: float,
    workshop: Workshop | None = None,
    drift: FloatArray | None = None,
    *,
    stable: bool = True,
) -> ComplexArray:
    """(n_freq, n_nodes) accelerance (fundamental over force) of an upward stepped sine at one force level [N].

    Lines whose motion is not stable are nan: a lab sees that they do not repeat, and leaves them out.

    stable : whether to look
    """
    machine = build_machine(rig, setting, effects, workshop)
    drift = np.zeros(N_DRIFTING) if drift is None else drift
    omega = 2 * np.pi * frequency_hz
    joints = joints_of(machine, setting, effects)
    balance = Balance(machine, joints, level, drift)
    if len(joints.laws):
        motions = balance.sweep(omega)
        if any(e.form == STEPPED for e in effects):
            forces = stepped_forces(balance, omega, motions)
        else:
            forces = balance.fundamentals(omega, motions)
        H = balance.accelerance(omega, forces)
        if stable and not any(e.id in ALWAYS_STABLE for e in effects):
            H[balance.growth(omega, motions) > GROWTH] = np.nan
        if np.isnan(H[:, 0]).mean() > MOST_LEFT_OUT:
            raise NotFoundError(f"at {level:g} N hardly any motion is stable")
    else:
        H = -(omega[:, None] ** 2) * balance.poles.between(machine.read, balance.drive, omega)[:, :, 0]
    return H * chain_factor(effects, frequency_hz, len(rig.nodes))


def bent_peaks(
    rig: Rig,
    setting: Setting,
    effects: Sequence[Effect],
    level: float,
    workshop: Workshop | None,
    peaks: Sequence[tuple[float, float]],
) -> list[tuple[float, float]]:
    """Peaks (frequency, half-power width of the linear rig) [Hz] that a first, coarser sweep at this level shows."""
    low, high = rig.plan.band_hz
    rough = np.concatenate([np.linspace(low, high, 96), *(cluster(f, 2 * width)[::2] for f, width in peaks)])
    rough = np.unique(rough[(rough >= low) & (rough <= high)])
    size = np.abs(swept_up(rig, setting, effects, rough, level, workshop, stable=False)).sum(axis=1)
    tops = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1
    tops = sorted(tops, key=lambda i: -size[i])[: len(peaks) + 1]
    widths = {f: width for f, width in peaks}
    shown = [(float(rough[i]), widths[min(widths, key=lambda f: abs(f - rough[i]))]) for i in tops]
    return shown or list(peaks)


def largest_travel(rig: Rig, setting: Setting, effect: Effect, level: float) -> tuple[float, float]:
    """Largest displacement [m] at the effect's joints without its law, and at which frequency [rad/s]."""
    machine = build_machine(rig, setting, (effect,))
    rows = np.array([machine.read[(effect.node or 1) - 1]] if effect.id == "rub" else [b.row for b in machine.bearings])
    top = 2 * np.pi * np.array([f for f, _ in resonances(machine)])
    travel = np.abs(Poles(machine, np.zeros(N_DRIFTING)).between(rows, machine.drive[None, :], top)).max(axis=(1, 2))
    return level * float(travel.max()), float(top[np.argmax(travel)])


def telling_levels(
    rig: Rig, setting: Setting, effect: Effect, rng: np.random.Generator, share: float = 1.0
) -> tuple[float, float, float]:
    """Three levels [N] round the one at which the linear resonance would reach the amplitude where the law is felt.

    share : of that level, for effects that are to be felt little
    """
    machine = build_machine(rig, setting, (effect,))
    reach = largest_travel(rig, setting, effect, 1.0)[0]
    k = machine.bearings[0].stiffness
    match effect.id:
        case "bearing_cubic":
            amplitude = np.sqrt(4 * k * rng.uniform(0.01, 0.1) / (3 * effect["stiffness"]))
        case "bearing_hertz":
            amplitude = rng.uniform(0.4, 1.2) * effect["preload"]
        case "bearing_clearance":
            amplitude = rng.uniform(1.2, 3.0) * effect["preload"] / k
        case "bearing_friction":
            amplitude = rng.uniform(2.0, 6.0) * effect["force"] * (1 / effect["stiffness"] + 1 / k)
        case "rub":
            amplitude = rng.uniform(1.3, 3.0) * effect["gap"]
        case _:
            amplitude = reach
    weakest, strongest = (limit * rig.scale.of("N") for limit in (1e-4, 300.0))
    middle = float(np.clip(share * amplitude / reach, weakest, strongest))
    return tuple(float(f"{middle * factor:.2g}") for factor in (0.3, 1.0, 3.0))  # type: ignore[return-value]


def stepped_forces(balance: Balance, omega: FloatArray, motions: FloatArray) -> ComplexArray:
    """(n_freq, nj) first harmonic of the joints' forces by time stepping from the balanced motions; nan: no repeat.

    The joints' forces alone drive the eigenvectors' coordinates, y' = lambda y - B f; what the exciter and the preload
    do without them is exact, and so is what their balanced mean does: a preload is far above what is added to it at
    low levels. What differs from the mean acts as kicks, as in ``Balance.growth``.
    """
    nc, nj = 2 * HARMONICS + 1, len(balance.joints.rows)
    values, B, C, D = balance.reduced()
    alone = np.array([balance.gamma @ balance.linear_part(float(w))[0].reshape(nj, nc).T for w in omega])
    alone = np.ascontiguousarray(alone.transpose(1, 2, 0))  # (N, nj, n_freq)
    h = 2 * np.pi / omega / SAMPLES
    free = np.exp(values[:, None] * h)
    mean = np.array(
        [balance.forces(u, float(w))[0].reshape(nj, nc)[:, 0] for u, w in zip(motions, omega, strict=True)]
    ).T
    held = (B / values[:, None]) @ mean  # (m, n_freq)
    y = _coordinates(balance, omega, motions, values, B).T - held
    x = alone[0]
    turn = 2 / SAMPLES * np.exp(-2j * np.pi * np.arange(SAMPLES) / SAMPLES)
    forces = np.zeros((REPEATS + 1, nj, len(omega)), dtype=complex)
    for period in range(PERIODS):
        place = period % len(forces)
        forces[place] = 0.0
        for k in range(SAMPLES):
            x, f = _at_joints(balance, alone[k] + (C @ (held + y)).real, D.diagonal(), x)
            forces[place] += turn[k] * f
            y = free * (y - B @ (h * (f - mean)))
    last = forces[(PERIODS - 1) % len(forces)]
    least = max(1e-2 * np.abs(last).max(), UNFELT * balance.level)
    spread = np.abs(forces - last).max(axis=0) / np.maximum(np.abs(last), least)
    return np.where((spread < SPREAD).all(axis=0), last, np.nan).T


def _at_joints(balance: Balance, x0: FloatArray, D: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(nj, n_freq) displacements and forces with x = x0 - D f(x), by Newton's method from the sample before."""
    at, f = x.copy(), np.empty_like(x0)
    change, slope = np.zeros_like(x0[0]), np.zeros_like(x0[0])
    for j, law in enumerate(balance.joints.laws):
        assert isinstance(law, Memoryless)
        for _ in range(2):
            f[j], slope = law.at(at[j])
            change = (x0[j] - D[j] * f[j] - at[j]) / (1 + D[j] * slope)
            at[j] += change
        f[j] += slope * change
    return at, f


def _coordinates(
    balance: Balance, omega: FloatArray, motions: FloatArray, values: ComplexArray, B: ComplexArray
) -> ComplexArray:
    """(n_freq, m) what the balanced forces of the joints have made of the eigenvectors' coordinates at time zero."""
    nc, nj = 2 * HARMONICS + 1, len(balance.joints.rows)
    k = np.arange(1, HARMONICS + 1)
    y = np.empty((len(omega), len(values)), dtype=complex)
    for i, (u, w) in enumerate(zip(motions, omega, strict=True)):
        n = balance.forces(u, float(w))[0].reshape(nj, nc)
        N = B @ (n[:, 1::2] + 1j * n[:, 2::2])  # (m, H)
        conjugate = B @ (n[:, 1::2] - 1j * n[:, 2::2])
        turning = 1j * k * w
        both = N / (turning - values[:, None]) + conjugate / (-turning - values[:, None])
        y[i] = (B @ n[:, 0]) / values - both.sum(axis=1) / 2
    return y


def _interleaved(a: FloatArray, b: FloatArray) -> FloatArray:
    """Columns a0, b0, a1, b1, ..."""
    return np.stack([a, b], axis=2).reshape(len(a), -1)
