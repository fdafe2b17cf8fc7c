"""ROSS' Rubbing fault: steady motion of a rotor that touches a ring, from its Newmark integration.

One element per span, so that a comparison needs the same mesh. ROSS takes the contact force from the motion one time
step earlier, so the error is of first order in the step; three steps are extrapolated to zero.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from model import Case, Lateral, Options, build, receptance, split, unit_force
from ross.faults.rubbing import Rubbing
from scipy.optimize import root
from standing import turned_stiffness

HARMONICS = (1, 2, 3, 4, 5)
STEPS_PER_PERIOD = (512, 1024, 2048)


@dataclass(frozen=True)
class RubTest:
    """One test: a ring round a node, and a force in y (unbalance_kg_m is None) or an unbalance.

    gap [m], contact_stiffness [N/m] without damping and friction; force_N at force_node, F sin(wt), or unbalance
    [kg m] at force_node with phase 0 on a rotor that spins at w.
    """

    options: Options
    frequency_hz: float
    rub_node: int
    gap: float
    contact_stiffness: float
    force_node: int
    force_N: float | None = None
    unbalance_kg_m: float | None = None
    periods: int = 60

    @property
    def omega(self) -> float:
        """Fundamental frequency, and the spin speed with an unbalance [rad/s]."""
        return 2 * np.pi * self.frequency_hz

    @property
    def spin(self) -> float:
        """Spin speed [rad/s]; a shaken rotor stands."""
        return self.omega if self.force_N is None else 0.0


_SOFT = Options(k_b=(1e6, 1e6), damping=500.0, elements_per_span=1)
_TURNED = turned_stiffness(1e6, 0.3, np.radians(30))
_TURNED_SOFT = Options(stiffness_yz=_TURNED, damping=500.0, elements_per_span=1)
TESTS = {
    "standing_sine": RubTest(_SOFT, 60.0, rub_node=3, gap=2e-5, contact_stiffness=5e5, force_node=2, force_N=20.0),
    "unbalance_isotropic": RubTest(
        _SOFT, 60.0, rub_node=3, gap=4e-5, contact_stiffness=5e5, force_node=3, unbalance_kg_m=3e-4
    ),
    "unbalance_anisotropic": RubTest(
        _TURNED_SOFT, 60.0, rub_node=3, gap=6e-5, contact_stiffness=5e5, force_node=3, unbalance_kg_m=3e-4
    ),
}


def rub() -> Case:
    """Harmonics of the steady displacement [m] at nodes 1 to 7."""
    return {
        "elements_per_span": 1,
        "meaning": "q(t) = q_0 + sum Re(q_h e^{ihwt}) [m]; force F sin(wt) in y at force_node, or unbalance u w^2 "
        "(cos wt, sin wt) in (y, z) with spin w; the contact pushes back with contact_stiffness (r - gap) where the "
        "rub node's r = sqrt(y^2 + z^2) exceeds gap, no friction, no contact damping; [harmonic][node]",
        "harmonics": HARMONICS,
        "steps_per_period": STEPS_PER_PERIOD,
        "tests": {name: steady_motion(test) for name, test in TESTS.items()},
    }


def steady_motion(test: RubTest) -> Case:
    """Inputs, extrapolated harmonics of nodes 1 to 7, and checks."""
    system = build(test.options)
    runs = [integrate(system, test, steps) for steps in STEPS_PER_PERIOD]
    coarse, middle, fine = (harmonics(run[-steps:]) for run, steps in zip(runs, STEPS_PER_PERIOD, strict=True))
    earlier = harmonics(runs[-1][-5 * STEPS_PER_PERIOD[-1] : -4 * STEPS_PER_PERIOD[-1]])
    q = (coarse - 6 * middle + 8 * fine) / 3  # free of errors proportional to the step and to its square
    size = np.abs(q).max()
    q = np.where(np.abs(q) < 1e-10 * size, 0.0, q)
    balance = alternating_balance(system, test, q)
    at_rub = np.hypot(*(runs[-1][-STEPS_PER_PERIOD[-1] :, axis, test.rub_node - 1] for axis in (0, 1)))
    return {
        "bearing_stiffness_yz_N_per_m": test.options.k_b[0] * np.eye(2)
        if test.options.stiffness_yz is None
        else test.options.stiffness_yz,
        "bearing_damping_Ns_per_m": test.options.damping,
        "frequency_hz": test.frequency_hz,
        "spin_rad_per_s": test.spin,
        "rub_node": test.rub_node,
        "gap_m": test.gap,
        "contact_stiffness_N_per_m": test.contact_stiffness,
        "force_node": test.force_node,
        "force_N": test.force_N,
        "unbalance_kg_m": test.unbalance_kg_m,
        "share_of_time_in_contact": float(np.mean(at_rub > test.gap)),
        **{plane: split(q[axis]) for axis, plane in enumerate("yz")},
        "checks": {
            "meaning": "largest differences over the largest harmonic: between the two finest steps, between "
            "extrapolation from two and from three steps, from four periods earlier, from a harmonic balance with 60 "
            "harmonics on ROSS' matrices; the last also for the third harmonic over the largest third harmonic",
            "finest_steps": float(np.abs(fine - middle).max() / size),
            "extrapolation": float(np.abs(q - (2 * fine - middle)).max() / size),
            "settled": float(np.abs(fine - earlier).max() / size),
            "harmonic_balance": float(np.abs(q - balance).max() / size),
            "harmonic_balance_third": third_difference(q, balance),
        },
    }


def third_difference(a: np.ndarray, b: np.ndarray) -> float | None:
    """Difference of the third harmonics over the largest of them; None where there is none."""
    size = np.abs(a[:, 2]).max()
    return float(np.abs(a[:, 2] - b[:, 2]).max() / size) if size else None


def integrate(system: Lateral, test: RubTest, steps: int) -> np.ndarray:
    """(n_steps, 2, 7) displacements in y and z of nodes 1 to 7, from rest, by ROSS' Newmark integration."""
    rotor = system.rotor
    t = np.arange(test.periods * steps + 1) / (steps * test.frequency_hz)
    fault = Rubbing(
        rotor,
        n=int(system.stations[test.rub_node - 1]),
        distance=test.gap,
        contact_stiffness=test.contact_stiffness,
        contact_damping=0.0,
        friction_coeff=0.0,
    )
    node = int(system.stations[test.force_node - 1])
    with contextlib.redirect_stdout(io.StringIO()):
        if test.force_N is None:
            result = fault.run([node], [test.unbalance_kg_m], [0.0], test.spin, t, tol=1e-8)
        else:
            result = run_standing(fault, node, test.force_N * np.sin(test.omega * t), t)
    columns = system.dofs[[system.read_out("y"), system.read_out("z")]]
    return result.yout[1:, columns]


def run_standing(fault: Rubbing, node: int, force: np.ndarray, t: np.ndarray) -> Any:
    """What ``fault.run`` does, for a force along ROSS' x at a node of a rotor that stands."""
    rotor = fault.rotor
    F = np.zeros((len(t), rotor.ndof))
    F[:, rotor.number_dof * node] = force
    fault.forces = np.zeros((rotor.ndof, len(t)))
    return rotor.run_time_response(
        speed=0.0,
        F=F,
        t=t,
        method="newmark",
        add_to_RHS=lambda step, **state: fault._get_force_over_time(step, state["disp_resp"], state["velc_resp"], 0.0),
        tol=1e-8,
    )


def harmonics(period: np.ndarray) -> np.ndarray:
    """(2, n_harmonics, 7) complex harmonics of one period whose last sample is at phase zero."""
    q = np.fft.rfft(np.roll(period, 1, axis=0), axis=0) * 2 / len(period)
    return np.moveaxis(q[list(HARMONICS)], 0, 1)


def alternating_balance(system: Lateral, test: RubTest, start: np.ndarray, orders: int = 60) -> np.ndarray:
    """(2, n_harmonics, 7) the same steady motion from ROSS' matrices by harmonic balance, ``orders`` harmonics.

    Unknown is the rub node's motion in (y, z); the contact force is evaluated on 2048 samples of a period.
    """
    samples = 2048
    h = np.arange(orders + 1)
    # e^{ihwt} coefficients; order 0 is static, solved at a frequency too low to matter.
    hz = np.where(h == 0, 1e-6, h * test.frequency_hz)
    at_rub = [system.place(test.rub_node, plane) for plane in "yz"]
    read = np.array([system.read_out(plane) for plane in "yz"])
    H = np.array([receptance(system, hz, unit_force(system, test.rub_node, p), test.spin) for p in "yz"])
    driven = np.zeros((orders + 1, len(system.dofs)), dtype=complex)
    driven[1] = receptance(system, hz[1:2], drive(system, test), test.spin)[0]

    def contact(q: np.ndarray) -> np.ndarray:
        """Harmonics (orders + 1, 2) of the contact force for harmonics of the motion."""
        time = np.fft.irfft(q * (samples / 2) * np.where(h == 0, 2, 1)[:, None], samples, axis=0)
        r = np.hypot(time[:, 0], time[:, 1])
        force = -test.contact_stiffness * time * (np.maximum(r - test.gap, 0) / np.maximum(r, 1e-30))[:, None]
        return np.fft.rfft(force, axis=0)[: orders + 1] * 2 / samples / np.where(h == 0, 2, 1)[:, None]

    def motion(force: np.ndarray) -> np.ndarray:
        return driven + np.einsum("phd,hp->hd", H, force)

    def residual(x: np.ndarray) -> np.ndarray:
        q = (x[: x.size // 2] + 1j * x[x.size // 2 :]).reshape(orders + 1, 2) * test.gap
        q[0] = q[0].real
        difference = (motion(contact(q))[:, at_rub] - q) / test.gap
        return np.concatenate([difference.real.ravel(), difference.imag.ravel()])

    guess = np.zeros((orders + 1, 2), dtype=complex)
    guess[1 : len(HARMONICS) + 1] = start[:, :, test.rub_node - 1].T / test.gap
    solution = root(residual, np.concatenate([guess.real.ravel(), guess.imag.ravel()]), method="krylov", tol=1e-11)
    q = (solution.x[: guess.size] + 1j * solution.x[guess.size :]).reshape(guess.shape) * test.gap
    return np.moveaxis(motion(contact(q))[list(HARMONICS)][:, read], 0, 1)


def drive(system: Lateral, test: RubTest) -> np.ndarray:
    """Complex force pattern of the drive: F sin(wt) is -iF, the unbalance turns from y to z."""
    y, z = (system.place(test.force_node, plane) for plane in "yz")
    force = np.zeros(len(system.dofs), dtype=complex)
    if test.force_N is not None:
        force[y] = -1j * test.force_N
    else:
        force[y] = test.unbalance_kg_m * test.omega**2
        force[z] = -1j * force[y]
    return force
