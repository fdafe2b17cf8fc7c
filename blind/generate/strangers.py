"""Five mechanisms that are in nobody's library (set W8); ranges and places stand in ``effects.KINDS``.

tuned_absorber      a mass m on a spring and a damper at a node: f_a = sqrt(k/m)/(2 pi), loss 2 zeta_a sqrt(k m).
common_base         both bearings stand on one plate of mass m on a spring and a damper, which couples left and right.
voice_coil          a magnet pulls at the drive node and its coil brakes: d = -k_m + i w (B l)^2/R / (1 + i w tau).
end_coupling        half a soft coupling, mass m on a spring k, hangs on an arm a beyond the right end of the shaft, so
                    that it feels the end's tilt: its spring acts on w + a s.
crosstalk           one channel picks up a constant share of another: H_i -> H_i + epsilon H_j.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rigtwin.blind.generate.draft import Draft
from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.rig import ComplexArray, FloatArray, Rig

Adder = Callable[[Draft, Effect, Rig, Sequence[float], FloatArray], None]


def _absorber(draft: Draft, effect: Effect, rig: Rig, nodes: Sequence[float], drive: FloatArray) -> None:
    omega = 2 * np.pi * effect["frequency"]
    at = draft.shaft.deflection(nodes[(effect.node or 1) - 1])
    mass = draft.add_coordinate(effect["mass"])
    stiffness = effect["mass"] * omega**2
    draft.spring(draft.widen(at) - mass, stiffness, 2 * effect["damping_ratio"] * effect["mass"] * omega)


def _coil(draft: Draft, effect: Effect, rig: Rig, nodes: Sequence[float], drive: FloatArray) -> None:
    draft.spring(drive, -effect["pull"])

    def brake(omega: FloatArray) -> ComplexArray:
        return 1j * omega * effect["braking"] / (1 + 1j * omega * effect["time_constant"])

    draft.springs.append((drive, brake))


def _coupling(draft: Draft, effect: Effect, rig: Rig, nodes: Sequence[float], drive: FloatArray) -> None:
    end = draft.shaft.deflection(nodes[-1] + effect["arm"])
    mass = draft.add_coordinate(effect["mass"])
    draft.spring(draft.widen(end) - mass, effect["stiffness"], effect["damping"])


ADDERS: dict[str, Adder] = {"tuned_absorber": _absorber, "voice_coil": _coil, "end_coupling": _coupling}


def base_plate(draft: Draft, effect: Effect) -> FloatArray:
    """Row of the plate that all bearings stand on."""
    plate = draft.add_coordinate(effect["mass"])
    omega = 2 * np.pi * effect["frequency"]
    draft.spring(plate, effect["mass"] * omega**2, 2 * effect["damping_ratio"] * effect["mass"] * omega)
    return plate


def with_crosstalk(H: ComplexArray, effects: Sequence[Effect], source: int) -> ComplexArray:
    """(n_freq, n_nodes) with what a channel picks up of another node's."""
    for effect in effects:
        if effect.id == "crosstalk":
            H = H.copy()
            H[:, (effect.node or 1) - 1] += effect["share"] * H[:, source - 1]
    return H
