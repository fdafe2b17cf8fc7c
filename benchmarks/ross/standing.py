"""Cases of the standing rotor: natural frequencies and frequency responses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from model import (
    DISK_ID_KG_M2,
    FORCE_NODE,
    Case,
    Lateral,
    Options,
    Pedestal,
    build,
    build_rotor,
    frequencies_hz,
    largest_relative_difference,
    lateral_modal_hz,
    lines_hz,
    plane_frequencies_hz,
    receptance,
    split,
    unit_force,
)

K_B = (1e6, 1e7)


def both(k_b: float) -> tuple[float, float]:
    """The same stiffness left and right [N/m]."""
    return (k_b, k_b)


def frf(system: Lateral, planes: str = "y", K: np.ndarray | None = None) -> Case:
    """Receptance [m/N] at nodes 1 to 7 for a force in y at node 2; [line][node]."""
    resonances = plane_frequencies_hz(system, "y", K) if planes == "y" else frequencies_hz(system, K)[:8]
    f = lines_hz(resonances)
    q = receptance(system, f, unit_force(system), K=K)
    result: Case = {"frequency_hz": f, **{plane: split(q[:, system.read_out(plane)]) for plane in planes}}
    if len(system.pedestals):
        result["pedestals_y"] = split(q[:, system.pedestals[:, 0]])
    return result


def transfer_matrix_difference(system: Lateral) -> float:
    """Largest difference of the receptance from ROSS' transfer_matrix(speed=0), over the largest of each line."""
    frequency_hz = np.array([40.0, 150.0, 310.0])
    rows = system.read_out("y")
    ours = receptance(system, frequency_hz, unit_force(system))[:, rows]
    column = system.dofs[system.place(FORCE_NODE, "y")]
    theirs = np.array(
        [
            system.rotor.transfer_matrix(speed=0, frequency=2 * np.pi * f)[system.dofs[rows], column]
            for f in frequency_hz
        ]
    )
    return float(np.max(np.abs(ours - theirs).max(axis=1) / np.abs(theirs).max(axis=1)))


def run_modal_difference(options: Options) -> float:
    """Largest relative difference of the first 8 lateral frequencies from ROSS' run_modal, undamped."""
    pedestal = None if options.pedestal is None else replace(options.pedestal, damping=0.0)
    spring = None if options.spring_y is None else (*options.spring_y[:2], 0.0)
    system = build(replace(options, damping=0.0, pedestal=pedestal, spring_y=spring))
    theirs, _ = lateral_modal_hz(system.rotor, system.rotor.run_modal(0.0, num_modes=32))
    return largest_relative_difference(np.sort(theirs)[:8], frequencies_hz(system)[:8])


def nominal() -> Case:
    """Point-mass disks on three bearing stiffnesses; also the mesh's convergence."""
    stiffnesses = (1e6, 1e7, 1e9)
    systems = {k: build(Options(k_b=both(k))) for k in stiffnesses}
    return {
        "k_b_N_per_m": stiffnesses,
        "f_hz": [plane_frequencies_hz(system, "y") for system in systems.values()],
        "receptance": [frf(system) for system in systems.values()],
        "mesh": {
            "meaning": "f_hz at k_b with so many elements in each of the six spans",
            "elements_per_span": (1, 2, 4, 8, 16),
            "f_hz": [
                [plane_frequencies_hz(build(Options(k_b=both(k), elements_per_span=n)), "y") for k in stiffnesses]
                for n in (1, 2, 4, 8, 16)
            ],
        },
        "checks": {
            "transfer_matrix": max(transfer_matrix_difference(system) for system in systems.values()),
            "run_modal": max(run_modal_difference(Options(k_b=both(k))) for k in stiffnesses),
        },
    }


def element() -> Case:
    """Matrices of one shaft element 59.5 mm long, on (y, z, theta_y, theta_z) left and right; K_tension is per N."""
    lateral = np.ix_([0, 1, 3, 4, 6, 7, 9, 10], [0, 1, 3, 4, 6, 7, 9, 10])
    unloaded = build_rotor(Options(elements_per_span=1)).shaft_elements[0]
    stretched = build_rotor(Options(axial_force=1e9, elements_per_span=1)).shaft_elements[0]
    return {
        "length_m": unloaded.L,
        "shear_factor": unloaded.kappa,
        "M": unloaded.M()[lateral],
        "K": unloaded.K()[lateral],
        "G_per_rad_per_s": unloaded.G()[lateral],
        "K_tension_per_N": (stretched.K() - unloaded.K())[lateral] / 1e9,
    }


def one_plane(options: Options, k_b: tuple[float, ...] = K_B) -> Case:
    """Frequencies [Hz] of one plane at each k_b, and the frequency response at the first."""
    systems = [build(replace(options, k_b=both(k))) for k in k_b]
    return {
        "k_b_N_per_m": k_b,
        "f_hz": [plane_frequencies_hz(system, "y") for system in systems],
        "receptance": [frf(systems[0])],
        "checks": {
            "transfer_matrix": transfer_matrix_difference(systems[0]),
            "run_modal": run_modal_difference(replace(options, k_b=both(k_b[0]))),
        },
    }


def bearing_tilt_stiffness() -> Case:
    """Rotational springs [N m/rad] at both bearings, about y and z, added to ROSS' K: its bearing has none."""
    tilt_stiffnesses = (2e3, 2e4)
    f_hz, responses = [], []
    for tilt in tilt_stiffnesses:
        rows = []
        for k in K_B:
            system = build(Options(k_b=both(k)))
            K = with_tilt(system, tilt)
            rows.append(plane_frequencies_hz(system, "y", K))
            if k == K_B[0]:
                responses.append(frf(system, K=K))
        f_hz.append(rows)
    return {"tilt_stiffness_Nm_per_rad": tilt_stiffnesses, "k_b_N_per_m": K_B, "f_hz": f_hz, "receptance": responses}


def with_tilt(system: Lateral, tilt_stiffness: float) -> np.ndarray:
    """K with a rotational spring [N m/rad] at both ends, about y and z."""
    K = system.K.copy()
    for node in (system.stations[0], system.stations[-1]):
        for place in (4 * node + 2, 4 * node + 3):
            K[place, place] += tilt_stiffness
    return K


def disk_inertia() -> Case:
    """The solid disks' diametral inertia; the polar one acts on torsion only while the rotor stands."""
    return {"diametral_inertia_kg_m2": DISK_ID_KG_M2, **one_plane(Options(disk_id=DISK_ID_KG_M2))}


def attached_mass() -> Case:
    """0.2 kg at node 4, a disk without inertia."""
    return {"node": 4, "mass_kg": 0.2, **one_plane(Options(masses=((4, 0.2),)))}


def exciter_suspension() -> Case:
    """Spring and damper to ground at node 2, in y only."""
    spring = (FORCE_NODE, 3e4, 1.0)
    return {
        "node": spring[0],
        "stiffness_N_per_m": spring[1],
        "damping_Ns_per_m": spring[2],
        **one_plane(Options(spring_y=spring)),
    }


def pedestal_flexibility() -> Case:
    """Each bearing (k_b, c) stands on a mass that stands on a spring and a damper; in y and z."""
    pedestal = Pedestal(stiffness=1e7, mass=2.0, damping=50.0)
    return {
        "stiffness_N_per_m": pedestal.stiffness,
        "mass_kg": pedestal.mass,
        "damping_Ns_per_m": pedestal.damping,
        "meaning": "k_b with 100 N s/m lies between shaft and pedestal mass; pedestals_y is [line][left, right]",
        **one_plane(Options(pedestal=pedestal)),
    }


def bearing_asymmetry() -> Case:
    """Unequal bearings."""
    system = build(Options(k_b=(1.2e6, 0.8e6)))
    return {
        "k_left_N_per_m": 1.2e6,
        "k_right_N_per_m": 0.8e6,
        "f_hz": plane_frequencies_hz(system, "y"),
        "receptance": [frf(system)],
    }


def bearing_offset() -> Case:
    """Both bearings act 3 mm inside the shaft's ends, where ROSS has mesh nodes of their own."""
    return {"offset_m": 0.003, **one_plane(Options(bearing_offset=0.003))}


def turned_stiffness(k_b: float, anisotropy: float, angle_rad: float) -> np.ndarray:
    """2 x 2 bearing matrix in (y, z): k_b (1 +- a/2) along axes turned from y towards z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.array([[c, -s], [s, c]])
    return k_b * R @ np.diag([1 + anisotropy / 2, 1 - anisotropy / 2]) @ R.T


def plane_anisotropy() -> Case:
    """Anisotropic bearings, along the axes and turned by 30 degrees from y towards z."""
    angles_deg = (0.0, 30.0)
    matrices = [turned_stiffness(1e6, 0.3, np.radians(angle)) for angle in angles_deg]
    systems = [build(Options(stiffness_yz=matrix)) for matrix in matrices]
    return {
        "k_b_N_per_m": 1e6,
        "anisotropy": 0.3,
        "angle_deg": angles_deg,
        "stiffness_yz_N_per_m": matrices,
        "f_hz_both_planes": [frequencies_hz(system)[:8] for system in systems],
        "receptance": [frf(system, planes="yz") for system in systems],
        "checks": {"transfer_matrix": max(transfer_matrix_difference(system) for system in systems)},
    }


def axial_load() -> Case:
    """Constant axial force, tension positive; ROSS' geometric stiffness is N int w'^T w' dx."""
    forces = (-1e4, 0.0, 1e4)
    return {
        "axial_force_N": forces,
        "k_b_N_per_m": K_B,
        "f_hz": [
            [plane_frequencies_hz(build(Options(k_b=both(k), axial_force=force)), "y") for k in K_B] for force in forces
        ],
        "checks": {"run_modal": run_modal_difference(Options(axial_force=1e4))},
    }
