"""Cases of the spinning rotor: whirl, critical speeds, unbalance, harmonic balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from model import (
    DISK_ID_KG_M2,
    DISK_IP_KG_M2,
    FORCE_NODE,
    Case,
    Lateral,
    Options,
    build,
    frequencies_hz,
    lateral_modal_hz,
    lines_hz,
    plane_frequencies_hz,
    receptance,
    split,
    unit_force,
    whirl_hz,
)
from scipy.linalg import eigh
from standing import K_B, both, turned_stiffness

SOLID_DISKS = Options(disk_id=DISK_ID_KG_M2, disk_ip=DISK_IP_KG_M2)
SPINS = tuple(float(spin) for spin in (0, 500, 1000, 1500, 2000, 2500, 3000, 3500, 4000, 4500, 5000))


def gyroscopic() -> Case:
    """Undamped whirl of the rotor with solid disks, a Campbell diagram, critical speeds, a response at spin."""
    return {
        "diametral_inertia_kg_m2": DISK_ID_KG_M2,
        "polar_inertia_kg_m2": DISK_IP_KG_M2,
        "bearing_damping_Ns_per_m": 0.0,
        "k_b_N_per_m": K_B,
        "spin_rad_per_s": SPINS,
        "whirl": [campbell(replace(SOLID_DISKS, k_b=both(k), damping=0.0)) for k in K_B],
        "response_at_spin": response_at_spin(2000.0),
    }


def campbell(options: Options) -> Case:
    """Backward and forward whirl frequencies [Hz], [spin][mode], and critical speeds [rad/s] at one k_b."""
    system = build(options)
    whirl = [whirl_at(system, spin) for spin in SPINS]
    return {
        "backward_hz": [w["backward"] for w in whirl],
        "forward_hz": [w["forward"] for w in whirl],
        "critical_speeds_rad_per_s": critical_speeds(system),
        "checks": {
            "run_campbell": campbell_difference(system, whirl),
            "run_critical_speed": critical_speed_difference(system),
        },
    }


def whirl_at(system: Lateral, spin: float) -> dict[str, np.ndarray]:
    """The first four backward and forward whirl frequencies [Hz]; at rest they coincide and have no direction."""
    if spin == 0:
        f = plane_frequencies_hz(system, "y")
        return {"backward": f, "forward": f}
    return whirl_hz(system, spin)


def critical_speeds(system: Lateral, n: int = 4) -> Case:
    """Speeds that equal a whirl frequency [rad/s]: K - W^2 (M - i G) is singular on circular orbits.

    There i G is real and symmetric, so each direction is one symmetric eigenvalue problem.
    """
    result: Case = {}
    for direction, sign in (("forward", -1j), ("backward", 1j)):
        T = circular_orbits(system, sign)
        stiffness = (T.conj().T @ system.K @ T).real
        mass = (T.conj().T @ (system.M - 1j * system.G) @ T).real
        inverse_squares = eigh(mass, stiffness, eigvals_only=True)  # the mass need not be definite
        positive = np.sort(inverse_squares[inverse_squares > 0])[::-1]
        result[direction] = 1 / np.sqrt(positive[:n])
    return result


def circular_orbits(system: Lateral, sign: complex) -> np.ndarray:
    """(n, n/2) basis of circular orbits: z = sign y, and theta_y = -sign theta_z (the slope in z is -theta_y)."""
    n_nodes = len(system.rotor.nodes)
    T = np.zeros((4 * n_nodes, 2 * n_nodes), dtype=complex)
    for i in range(n_nodes):
        T[4 * i, 2 * i], T[4 * i + 1, 2 * i] = 1, sign
        T[4 * i + 3, 2 * i + 1], T[4 * i + 2, 2 * i + 1] = 1, -sign
    return T / np.sqrt(2)


def campbell_difference(system: Lateral, whirl: list[dict[str, np.ndarray]]) -> float:
    """Largest relative difference of the first 8 frequencies from ROSS' run_campbell; no direction may contradict.

    ROSS says "Mixed" where a mesh node stands still and its orbit's sense is round-off.
    """
    result = system.rotor.run_campbell(np.array(SPINS), frequencies=14)
    largest = 0.0
    for spin, ours in zip(SPINS, whirl, strict=True):
        theirs, named = lateral_modal_hz(system.rotor, result.modal_results[spin])
        order = np.argsort(theirs)[:8]
        merged = sorted((f, name) for name in ("backward", "forward") for f in ours[name])
        n = 8 if spin == 0 else sum(f < min(max(ours["backward"]), max(ours["forward"])) for f, _ in merged)
        for place, (f, name) in list(zip(order, merged, strict=True))[:n]:
            largest = max(largest, abs(theirs[place] / f - 1))
            assert spin == 0 or named[place] in (name.capitalize(), "Mixed"), f"{name} at {f} Hz, {spin} rad/s"
    return largest


def critical_speed_difference(system: Lateral) -> float:
    """Largest relative difference of our critical speeds from those ROSS' run_critical_speed finds (first six)."""
    theirs = system.rotor.run_critical_speed(num_modes=20, rtol=1e-9).wd()
    ours = np.sort(np.concatenate([speeds[:3] for speeds in critical_speeds(system).values()]))
    return max(float(np.min(np.abs(theirs - speed)) / speed) for speed in ours)


def response_at_spin(spin: float) -> Case:
    """Receptance [m/N] for a force in y at node 2 of the rotor that spins at ``spin`` [rad/s], 100 N s/m."""
    system = build(replace(SOLID_DISKS, k_b=both(1e6)))
    whirl = whirl_hz(build(replace(SOLID_DISKS, k_b=both(1e6), damping=0.0)), spin)
    f = lines_hz(np.concatenate([whirl["backward"], whirl["forward"]]))
    q = receptance(system, f, unit_force(system), spin)
    column = system.dofs[system.place(FORCE_NODE, "y")]
    theirs = system.rotor.transfer_matrix(speed=spin, frequency=2 * np.pi * f[5])[system.dofs, column]
    return {
        "spin_rad_per_s": spin,
        "k_b_N_per_m": 1e6,
        "bearing_damping_Ns_per_m": 100.0,
        "receptance": {"frequency_hz": f, **{p: split(q[:, system.read_out(p)]) for p in "yz"}},
        "checks": {"transfer_matrix": float(np.abs(q[5] - theirs).max() / np.abs(theirs).max())},
    }


def unbalance() -> Case:
    """ROSS' run_unbalance_response: displacement [m] at nodes 1 to 7, amplitude and phase as a complex number."""
    variants = {
        "point_masses": Options(),
        "solid_disks": SOLID_DISKS,
        "solid_disks_anisotropic": replace(SOLID_DISKS, stiffness_yz=turned_stiffness(1e6, 0.3, np.radians(30))),
    }
    return {
        "node": 3,
        "unbalance_kg_m": 1e-4,
        "phase_rad": 0.0,
        "k_b_N_per_m": 1e6,
        "meaning": "the force is u w^2 (cos(wt + phase), sin(wt + phase)) in (y, z), the rotor spins at w; "
        "amplitude and phase of q(t) = Re(q e^{iwt}), [line][node]",
        "variants": {name: unbalance_response(options) for name, options in variants.items()},
    }


def unbalance_response(options: Options) -> Case:
    """One variant of ``unbalance``."""
    system = build(options)
    f = lines_hz(frequencies_hz(system)[:4], count=24)
    result = system.rotor.run_unbalance_response(
        node=int(system.stations[2]), unbalance_magnitude=1e-4, unbalance_phase=0.0, frequency=2 * np.pi * f
    )
    q = result.forced_resp.T[:, system.dofs]
    return {
        "bearing_stiffness_yz_N_per_m": options.stiffness_yz if options.stiffness_yz is not None else 1e6 * np.eye(2),
        "diametral_inertia_kg_m2": options.disk_id,
        "polar_inertia_kg_m2": options.disk_ip,
        "frequency_hz": f,
        **{
            plane: {
                "amplitude_m": np.abs(q[:, system.read_out(plane)]),
                "phase_rad": np.angle(q[:, system.read_out(plane)]),
            }
            for plane in "yz"
        },
    }


def harmonic_balance() -> Case:
    """ROSS' harmonic balance: a linear rotor that spins at W, driven at W, 2 W and 3 W by turning forces."""
    spin, node = 300.0, 3
    amplitudes, phases, harmonics = [9.0, 4.0, 2.0], [0.0, 0.5, -1.0], [1, 2, 3]
    system = build(replace(SOLID_DISKS, stiffness_yz=turned_stiffness(1e6, 0.3, np.radians(30))))
    result = system.rotor.run_harmonic_balance_response(
        speed=spin,
        t=np.linspace(0, 0.1, 101),
        harmonic_forces=[
            {"node": int(system.stations[node - 1]), "magnitudes": amplitudes, "phases": phases, "harmonics": harmonics}
        ],
        n_harmonics=3,
    )
    q = result.dQ.T[:, system.dofs]
    force = np.zeros((3, len(system.dofs)), dtype=complex)
    turning = np.array(amplitudes) * np.exp(1j * np.array(phases))
    force[:, system.place(node, "y")], force[:, system.place(node, "z")] = turning, -1j * turning
    direct = np.array(
        [receptance(system, np.array([h * spin / (2 * np.pi)]), force[h - 1], spin)[0] for h in harmonics]
    )
    return {
        "spin_rad_per_s": spin,
        "node": node,
        "force_N": amplitudes,
        "phase_rad": phases,
        "harmonics": harmonics,
        "bearing_stiffness_yz_N_per_m": turned_stiffness(1e6, 0.3, np.radians(30)),
        "bearing_damping_Ns_per_m": 100.0,
        "diametral_inertia_kg_m2": DISK_ID_KG_M2,
        "polar_inertia_kg_m2": DISK_IP_KG_M2,
        "meaning": "force h is F (cos(hWt + phase), sin(hWt + phase)) in (y, z); q(t) = sum Re(q_h e^{ihWt}) [m], "
        "[harmonic][node]",
        **{plane: split(q[:, system.read_out(plane)]) for plane in "yz"},
        "checks": {"direct_solution": float(np.abs(q - direct).max() / np.abs(direct).max())},
    }
