"""``rigtwin modes``: natural frequencies, damping, whirl and shapes."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigtwin.commands.asked_rotor import (
    DIRECTIONS,
    AskedRotor,
    RotorRequest,
    asked_rotor,
    lumped_disks,
    rotor_record,
    say_rotor,
    tell,
    user_errors,
)
from rigtwin.console import say, table
from rigtwin.errors import UserError
from rigtwin.rotor.frequency.modal import ListedModes, listed_modes
from rigtwin.rotor.frequency.shapes import shaft_shapes
from rigtwin.rotor.frequency.whirl import RPM, whirl_direction
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

# Points along the shaft at which a shape is drawn.
_POINTS = 121

# Modes that one picture shows.
_MOST_DRAWN = 12


def run_modes(request: RotorRequest, spin_rpm: float, n_modes: int) -> None:
    """Compute, draw, print."""
    if not np.isfinite(spin_rpm):
        raise UserError(f"--spin-rpm {spin_rpm}: give a number")
    if request.out and n_modes > _MOST_DRAWN:
        raise UserError(
            f"--modes {n_modes}: a picture holds {_MOST_DRAWN} modes at most; leave --out away, or ask for fewer"
        )
    asked = asked_rotor(request)
    spin_speed = spin_rpm * RPM
    with user_errors():
        modes = _lowest(listed_modes(asked.system, spin_speed), n_modes)
    direction = whirl_direction(asked.system, modes.shape) * (np.sign(spin_speed) or 1.0)
    shapes = shaft_shapes(asked.system, modes.shape, np.array(asked.rig.nodes_m))
    if request.out:
        _draw(asked, modes, direction, request)
    records = [_record(modes, direction, shapes, place) for place in range(len(modes.eigenvalue))]
    record = {**rotor_record(asked), "spin_rpm": spin_rpm, "nodes_m": asked.rig.nodes_m, "modes": records}

    def text() -> None:
        say_rotor(asked, f", spinning at {spin_rpm:g} rev/min" if spin_rpm else "")
        _print(modes, direction, shapes)

    tell(request, record, text, lumped_disks(asked) if spin_rpm else "")


def _lowest(modes: ListedModes, n: int) -> ListedModes:
    """All rigid-body motions, and the lowest oscillations."""
    last = np.count_nonzero(modes.rigid_body) + n
    return ListedModes(modes.eigenvalue[:last], modes.shape[:, :last], modes.plane[:last], modes.alike[:last])


def _numbers(modes: ListedModes) -> list[int]:
    """Numbers of the modes from 1; 0 for rigid-body motions."""
    n_rigid = int(np.count_nonzero(modes.rigid_body))
    return [max(0, place + 1 - n_rigid) for place in range(len(modes.eigenvalue))]


def motion(modes: ListedModes, direction: FloatArray, place: int) -> str:
    """'forward', 'in y', 'in y and z alike'."""
    if not modes.plane[place]:
        return DIRECTIONS[int(direction[place])]
    return "y and z alike" if modes.alike[place] else f"in {'yz'[modes.plane[place] - 1]}"


def _print(modes: ListedModes, direction: FloatArray, shapes: ComplexArray) -> None:
    rows = []
    for place, number in enumerate(_numbers(modes)):
        if not number:
            rows.append(("rigid body", "0", "", "", "", motion(modes, direction, place)))
            continue
        rows.append(
            (
                str(number),
                f"{modes.frequency_hz[place]:#.5g}",
                f"{modes.damped_frequency_hz[place]:#.5g}",
                f"{100 * modes.damping_ratio[place]:.4g}",
                f"{modes.log_decrement[place]:.4g}",
                motion(modes, direction, place),
            )
        )
    table(("mode", "frequency, Hz", "damped, Hz", "damping, %", "log decrement", "motion"), rows)
    if (modes.damping_ratio < 0).any():
        say("a negative damping means that the mode grows by itself: the rotor is unstable")
    say("shapes at the nodes, over the largest deflection, at the moment of the largest")
    header = ("mode", "plane", *(f"node {node}" for node in range(1, shapes.shape[1] + 1)))
    table(
        header,
        [row for place, number in enumerate(_numbers(modes)) for row in _shape_rows(number, shapes[:, :, place])],
    )


def _shape_rows(number: int, shape: ComplexArray) -> list[tuple[str, ...]]:
    """A row for each plane in which a mode moves; of orbits, y when it is largest and z a quarter of a period later."""
    rows = []
    name = str(number) if number else "rigid body"
    moves = [plane for plane in (0, 1) if np.abs(shape[plane]).max() > 1e-9]
    for plane in moves:
        quarter = np.abs(shape[plane].imag).max() > np.abs(shape[plane].real).max()
        values = -shape[plane].imag if quarter else shape[plane].real
        rows.append(
            (name, "yz"[plane] + (", ¼ period later" if quarter else ""), *(f"{v:+.3f}" for v in values.round(3) + 0.0))
        )
    return rows


def _record(modes: ListedModes, direction: FloatArray, shapes: ComplexArray, place: int) -> dict[str, Any]:
    """A mode for a machine."""
    whirls = not modes.plane[place]
    parts = {
        f"{plane}_{part}": getattr(shapes[row, :, place], name).tolist()
        for row, plane in enumerate("yz")
        for part, name in (("re", "real"), ("im", "imag"))
    }
    return {
        "mode": _numbers(modes)[place],
        "kind": "rigid_body" if modes.rigid_body[place] else "elastic",
        "frequency_hz": float(modes.frequency_hz[place]),
        "damped_frequency_hz": float(modes.damped_frequency_hz[place]),
        "damping_ratio": float(modes.damping_ratio[place]),
        "log_decrement": float(modes.log_decrement[place]),
        "direction": DIRECTIONS[int(direction[place])] if whirls else None,
        "plane": None if whirls else "yz"[modes.plane[place] - 1],
        "same_in_other_plane": bool(modes.alike[place]),
        "shape": parts,
    }


def _draw(asked: AskedRotor, modes: ListedModes, direction: FloatArray, request: RotorRequest) -> None:
    from rigtwin.pages.rotor_figures import DrawnMode, mode_figure, save_figure

    assert request.out
    x = np.union1d(np.linspace(0, asked.rig.length, _POINTS), asked.rig.nodes_m)
    lines = shaft_shapes(asked.system, modes.shape, x)
    places = np.searchsorted(x, asked.rig.nodes_m)
    drawn = [
        DrawnMode(_title(modes, direction, place), lines[:, :, place], lines[:, places, place], float(direction[place]))
        for place in range(len(modes.eigenvalue))
    ]
    save_figure(mode_figure(asked.rig, x, drawn, whirling=not modes.plane.all()), request.out)


def _title(modes: ListedModes, direction: FloatArray, place: int) -> str:
    number, words = _numbers(modes)[place], motion(modes, direction, place)
    if not number:
        return f"rigid body: 0 Hz, {words}"
    zeta = 100 * modes.damping_ratio[place]
    return f"mode {number}: {modes.frequency_hz[place]:#.5g} Hz, damping {zeta:.3g} %, {words}"
