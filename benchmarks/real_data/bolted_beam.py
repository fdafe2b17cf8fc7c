"""The Brake-Reuss beam: two half beams on a bolted lap joint, hung on bungees, driven by a shaker."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from benchmarks.real_data.data_set import Control, DataSet, Fold, MissingDataError, nrmse
from benchmarks.real_data.joint_law import JointedRig, fit_law
from benchmarks.real_data.single_mode import Sweep, leave_one_out
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import parse_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system

MAT = "ForcedFrequencyResponses.mat"

# Published: 720 x 25.4 x 12.7 mm of steel, a lap joint of 120 mm in the middle, bent about its weaker axis. A uniform
# beam has its first mode at 124 Hz, and small motions of this one have it at 80.5 Hz.
RIG = """
name = "brake-reuss-beam"
title = "Brake-Reuss beam 720 x 25.4 x 12.7 mm, lap joint in the middle, on bungees"
nodes_m = [0.0, 0.075, 0.15, 0.3, 0.36, 0.42, 0.57, 0.72]
elements_between_nodes = 2
shaft_damping_ratio = 0.0014
excitation_node = 2
[k_b]
start_N_per_m = 500
min_N_per_m = 50
max_N_per_m = 5000
[[support]]
node = 3
stiffness = "k_b"
[[support]]
node = 7
stiffness = "k_b"
[[segment]]
length_m = 0.72
youngs_modulus_Pa = 193e9
density_kg_per_m3 = 7900
area_m2 = 3.2258e-4
second_moment_y_m4 = 4.3357440e-9
second_moment_z_m4 = 1.7342976e-8
[[joint]]  # in place of the lap, as stiff as puts the first mode at 80.5 Hz
node = 5
tilt_stiffness_Nm_per_rad = 2155
"""
NODE, FIRST_HZ = 2, 80.2

# A tenth for where exactly force and motion were measured.
HEAD = """title = "Brake-Reuss beam, stepped sine under force control"
rig = "rig.toml"
[nominal]
gain_tolerance = 0.1
"""


def sweeps(folder: Path, control: str) -> list[Sweep]:
    """The sweeps under "ForceControl" or "ResponseControl". Raises MissingDataError where the file holds no such.

    The file gives the phase of the displacement beside the amplitude of the acceleration.
    """
    path = folder / MAT
    try:
        runs = scipy.io.loadmat(path, squeeze_me=True)["FRdata"][control].item()
        return [_sweep(f"{control} {k}", run) for k, run in enumerate(runs, start=1)]
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise MissingDataError(
            f"{path}: holds no FRdata.{control} as it was published ({error}); get it again"
        ) from error


def _sweep(name: str, run: Any) -> Sweep:
    frequency, force, amplitude, phase = (
        np.asarray(run[key], dtype=float) for key in ("frequency", "force", "amplitude", "phase")
    )
    return Sweep(name, frequency, force, -amplitude / force * np.exp(1j * phase))


def folds(data: Path, made: Path) -> list[Fold]:
    """Each sweep under force control in turn is left out."""
    every = sweeps(data, "ForceControl")
    found = []
    for held in every:
        fold = made / f"without_{held.name.split()[1]}"
        train = [sweep for sweep in every if sweep is not held]
        _campaign(fold / "train", train)
        _campaign(fold / "held", [held])
        found.append(
            Fold(f"sweep {held.name.split()[1]}, {np.median(held.force):.2g} N", fold / "train", fold / "held")
        )
    return found


def _campaign(folder: Path, runs: list[Sweep]) -> None:
    """A campaign as a laboratory would write it: magnitude, phase of the displacement, force of each line."""
    folder.mkdir(parents=True)
    (folder / "rig.toml").write_text(RIG, encoding="utf-8")
    toml = HEAD
    for run in runs:
        file = f"{run.name.replace(' ', '_')}.csv"
        toml += f'[[run]]\nfile = "{file}"\nsupport = "bearing"\nsweep = "up"\nphase_offset_deg = 180.0\n'
        degrees = np.degrees(np.angle(-run.H))
        columns = np.column_stack([run.frequency_hz, run.force, np.abs(run.H), degrees]).tolist()
        lines = [",".join(map(repr, row)) for row in columns]
        (folder / file).write_text(
            "\n".join(["frequency_Hz,force_N,node2_abs,node2_deg", *lines, ""]), encoding="utf-8"
        )
    (folder / "campaign.toml").write_text(toml, encoding="utf-8")


def controls(data: Path) -> list[Control]:
    """One mode with one damping and with a damping that grows; and the law of the joint."""
    held_response, held_force = sweeps(data, "ResponseControl"), sweeps(data, "ForceControl")
    own = "its natural frequency fitted to the sweep that is left out, its level known"
    found = [
        Control(f"{kind}, one mode, one damping; {own}", leave_one_out(of, FIRST_HZ))
        for kind, of in (
            ("eight sweeps under response control", held_response),
            ("four under force control", held_force),
        )
    ]
    found += [
        Control(f"{kind}, one mode, damping z0 + z1 (a/100 um)^1.7; {own}", leave_one_out(of, FIRST_HZ, 1.7))
        for kind, of in (
            ("eight sweeps under response control", held_response),
            ("four under force control", held_force),
        )
    ]
    known, alone = _joint(held_force)
    words = (
        "four under force control, rig with a joint whose stiffness and loss follow its angle; nothing fitted to the "
    )
    found.append(Control(f"{words}sweep that is left out, its level known", known))
    found.append(Control(f"{words}sweep that is left out, its level predicted from the force", alone))
    return found


def _joint(every: list[Sweep]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """NRMSE of each sweep by the joint's law of the others: at its measured level, and from the force alone."""
    models = {sweep.name: jointed(sweep) for sweep in every}
    known, alone = [], []
    for held in every:
        train = [sweep for sweep in every if sweep is not held]
        law, model = fit_law([models[sweep.name] for sweep in train], train), models[held.name]
        known.append(nrmse(held.H, model.respond(law, model.angle_at(law, held))[0]))
        alone.append(nrmse(held.H, model.predict(law, held.force)))
    return tuple(known), tuple(alone)


def jointed(sweep: Sweep) -> JointedRig:
    """The first elastic mode of the rig, without damping, at the lines of a sweep."""
    rig = parse_rig(RIG)
    (joint,) = rig.joint
    condition = Condition(k_b=rig.k_b.start_N_per_m, shaft_damping_ratio=0.0)
    system = build_system(assemble(rig), condition).in_plane(1)
    mode = int(np.argmin(np.abs(system.modes.omega - 2 * np.pi * FIRST_HZ)))
    return JointedRig(system, mode, NODE, float(joint.tilt_stiffness_Nm_per_rad), sweep.frequency_hz)


BOLTED_BEAM = DataSet(
    key="bolted-beam",
    title="Bolted beam",
    measured="Two half beams of steel, bolted together over a lap joint of 120 mm and hung on bungees, were driven by "
    "a shaker near one end. Twelve stepped sines through the first mode at 80 Hz were recorded with 41 lines each: "
    "four under force control and eight under response control, with force, acceleration and phase of every line. The "
    "campaigns hold the four under force control; each of them in turn is left out and predicted. In their rig the lap "
    "is a joint, a spring whose stiffness was set by hand: the first mode lies near 80 Hz. The controls that have "
    "a law of the joint give it a stiffness that falls with the angle until a second contact closes, and a loss that "
    "grows with the angle to the power of 1.7. The form of that law, and that the other modes are left out, was chosen "
    "with all sweeps in view: the error on new sweeps may be larger. Its numbers come without the sweep that is "
    "predicted.",
    source="https://github.com/mattiacenedese/BRBtesting",
    licence="GPL-3.0",
    files=(MAT,),
    folds=folds,
    controls=controls,
    silent="One accelerometer, one exciter and one mode cannot tell where along the beam a stiffness or a damping "
    "sits: that it is the joint is prior knowledge. Harmonics were not stored. The sweeps went upwards only, so that "
    "nothing is known of jumps on the way down, and their standard errors are not known. Between sweeps the resonance "
    "drifts by about one part in a thousand, half of its width at low level.",
)
