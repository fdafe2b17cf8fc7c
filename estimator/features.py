"""The three numbers that a test on two supports gives, with their standard errors."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.sim.campaign import MeasurementError, PeakList, Run
from rigtwin.sim.modal_fit import Mode, driving_point, fit_modes

FEATURE_NAMES = ("delta_f1", "delta_f2", "amplitude_ratio", "delta_f1_std", "delta_f2_std", "amplitude_ratio_std")


# Standard errors of a shift beyond which its sign is not noise.
_CERTAIN = 5.0


@dataclass(frozen=True)
class Features:
    """Shifts are rigid minus bearing support [Hz]; the ratio is A1/A0, bearing over rigid [-].

    A is the resonance acceleration of mode 1 at the driving point per unit force, from the modal
    fit and not from the highest line.
    """

    delta_f1: float
    delta_f2: float
    amplitude_ratio: float
    delta_f1_std: float
    delta_f2_std: float
    amplitude_ratio_std: float

    def as_array(self) -> np.ndarray:
        """(6,) in the order of FEATURE_NAMES."""
        return np.array(astuple(self))


def features_of_runs(rigid: Run, bearing: Run) -> Features:
    """Features of one rig measured on rigid supports and on its bearings.

    Raises
    ------
    MeasurementError : the supports are mixed up or exchanged, the runs were driven differently, the driving
        point was not measured, or a run does not show two resonances
    """
    _check_supports(rigid, bearing, "run")
    if (rigid.excitation_node, rigid.excitation_plane) != (bearing.excitation_node, bearing.excitation_plane):
        raise MeasurementError("the two runs were driven at different places: their amplitudes cannot be compared")
    forces = [(run.quantity, run.force_amplitude_N) for run in (rigid, bearing)]
    if "acceleration" in (rigid.quantity, bearing.quantity) and forces[0] != forces[1]:
        raise MeasurementError(
            "accelerations at constant exciter current compare only at the same quantity and force_amplitude_N; "
            f"the rigid run has {forces[0]}, the bearing run {forces[1]}"
        )
    (r1, r2), (b1, b2) = fit_modes(rigid, 2), fit_modes(bearing, 2)
    (a0, a0_std), (a1, a1_std) = _resonance_acceleration(rigid, r1), _resonance_acceleration(bearing, b1)
    for run, a, held in ((rigid, a0, "rigid supports"), (bearing, a1, "bearings")):
        if a == 0:
            raise MeasurementError(
                f"node {run.excitation_node} does not move in mode 1 on {held}: there is no amplitude ratio"
            )
    shifts = [r.frequency_hz - b.frequency_hz for r, b in ((r1, b1), (r2, b2))]
    stds = [float(np.hypot(r.frequency_std_hz, b.frequency_std_hz)) for r, b in ((r1, b1), (r2, b2))]
    if all(shift < -_CERTAIN * std for shift, std in zip(shifts, stds, strict=True)):
        raise MeasurementError(
            f"{rigid.name} resonates at {r1.frequency_hz:.4g} and {r2.frequency_hz:.4g} Hz, {bearing.name} at "
            f"{b1.frequency_hz:.4g} and {b2.frequency_hz:.4g} Hz: no rotor is stiffer on bearings than on rigid "
            "supports, so the two seem to be exchanged; give the run on rigid supports first, or correct support in "
            "campaign.toml"
        )
    return Features(
        delta_f1=shifts[0],
        delta_f2=shifts[1],
        amplitude_ratio=a1 / a0,
        delta_f1_std=stds[0],
        delta_f2_std=stds[1],
        amplitude_ratio_std=a1 / a0 * float(np.hypot(a0_std / a0, a1_std / a1)),
    )


def _check_supports(rigid: Run | PeakList, bearing: Run | PeakList, what: str) -> None:
    if (rigid.support, bearing.support) != ("rigid", "bearing"):
        raise MeasurementError(f"need a rigid and a bearing {what}, got {rigid.support!r} and {bearing.support!r}")


def _resonance_acceleration(run: Run, mode: Mode) -> tuple[float, float]:
    """Resonance acceleration of a mode at the driving point, with its standard error, whatever the run measures."""
    factor = (2 * np.pi * mode.frequency_hz) ** (DERIVATIVE_ORDER["accelerance"] - DERIVATIVE_ORDER[run.quantity])
    value, std = driving_point(run, mode, run.excitation_node, run.excitation_plane)
    return factor * value, factor * std


def features_of_peaks(
    rigid: PeakList, bearing: PeakList, amplitude_ratio: float, amplitude_ratio_std: float
) -> Features:
    """Features of two lists of resonances, the first two of each being modes 1 and 2.

    Raises
    ------
    MeasurementError : the supports are mixed up, or a list has fewer than two resonances

    >>> rigid = PeakList("rigid", np.array([100.0, 320.0]), std_hz=np.array([0.3, 0.3]))
    >>> bearing = PeakList("bearing", np.array([96.0, 300.0]), std_hz=np.array([0.4, 0.4]))
    >>> features_of_peaks(rigid, bearing, amplitude_ratio=1.2, amplitude_ratio_std=0.1).as_array()
    array([ 4. , 20. ,  1.2,  0.5,  0.5,  0.1])
    """
    _check_supports(rigid, bearing, "peak list")
    if len(rigid.frequencies_hz) < 2 or len(bearing.frequencies_hz) < 2:
        raise MeasurementError("two resonances on each support are needed")
    shift = rigid.frequencies_hz[:2] - bearing.frequencies_hz[:2]
    std = np.hypot(rigid.std_hz[:2], bearing.std_hz[:2])
    (df1, df2), (df1_std, df2_std) = shift.tolist(), std.tolist()
    return Features(df1, df2, amplitude_ratio, df1_std, df2_std, amplitude_ratio_std)
