"""Types of measured data: runs and campaigns, the same for a virtual and a real rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.frequency.measured import Quantity
from rigtwin.rotor.model import html
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition

SupportKind = Literal["rigid", "bearing"]
SUPPORTS: tuple[SupportKind, ...] = ("rigid", "bearing")
Plane = Literal["y", "z"]
SweepDirection = Literal["up", "down"]
Control = Literal["force", "response"]
Roving = Literal["exciter"]


class MeasurementError(ValueError):
    """Measured data cannot be used; the message names the file and the line or key."""


@dataclass(frozen=True, order=True)
class Channel:
    """An accelerometer: its node (from 1), the direction in which it measures, and a letter if it is not the only one.

    Sensors of one node and plane see the same motion; each has its own gain.

    >>> str(Channel(3)), str(Channel(3, "z")), str(Channel(3, label="b"))
    ('node3', 'node3_z', 'node3b')
    """

    node: int
    plane: Plane = "y"
    label: str = ""  # a small letter, or nothing

    def __str__(self) -> str:
        return f"node{self.node}{self.label}" + ("" if self.plane == "y" else f"_{self.plane}")


@dataclass(frozen=True)
class Run:
    """One stepped-sine run: one support condition, one exciter place, one force level.

    ``H`` is complex with time factor e^{+i omega t} and peak amplitudes. Where an instrument gave
    magnitudes only, ``magnitude_only`` is true and H is real and not negative.

    With ``roving = "exciter"`` a hammer went from node to node and one accelerometer stayed. The run is then written
    by reciprocity: the channels are the nodes that were struck, the excitation node is that of the accelerometer.
    """

    frequency_hz: FloatArray  # (n_freq,) increasing
    H: ComplexArray  # (n_freq, n_channels) response per force, or response where quantity is "acceleration"
    channels: tuple[Channel, ...]  # order of axis 1
    support: SupportKind
    std: FloatArray | None = None  # (n_freq, n_channels) standard error of H, sqrt(E|error|^2)
    harmonics: dict[int, ComplexArray] = field(default_factory=dict)  # order -> (n_freq, n_channels), unit of H
    quantity: Quantity = "accelerance"
    magnitude_only: bool = False
    excitation_node: int = 2
    excitation_plane: Plane = "y"
    force_amplitude_N: float | None = 1.0
    spin_rpm: float = 0.0
    sweep: SweepDirection | None = None
    name: str = ""
    swept_hz: FloatArray | None = None  # all lines that were swept, increasing, where only some of them are here
    force_N: FloatArray | None = None  # (n_freq,) peak force of each line, where it was recorded
    control: Control = "force"  # what a controller held during the sweep; under "response" the force varies
    roving: Roving | None = None

    def __post_init__(self) -> None:
        n, shape = len(self.frequency_hz), (len(self.frequency_hz), len(self.channels))
        if n == 0 or np.any(np.diff(self.frequency_hz) <= 0) or self.frequency_hz[0] <= 0:
            raise MeasurementError(f"run {self.name!r}: frequencies must be positive and increase")
        for label, array in [("H", self.H), ("std", self.std), *(self.harmonics.items())]:
            if array is not None and array.shape != shape:
                raise MeasurementError(f"run {self.name!r}: {label} has shape {array.shape}, expected {shape}")
        if self.force_N is not None and self.force_N.shape != (n,):
            raise MeasurementError(f"run {self.name!r}: force_N has shape {self.force_N.shape}, expected {(n,)}")

    def _repr_html_(self) -> str:
        """The channel that moves most over frequency, and how the run was made, for notebooks."""
        size = np.abs(self.H[:, self.channels.index(self.loudest)])
        drawn = html.curves([html.Line(self.frequency_hz, size)], "frequency, Hz", f"{self.quantity}, {self.loudest}")
        return drawn + html.facts(self._facts())

    @property
    def loudest(self) -> Channel:
        """The channel with the largest response."""
        return self.channels[int(np.argmax(np.nanmax(np.abs(self.H), axis=0)))]

    def _facts(self) -> list[tuple[str, object]]:
        force = "of unknown size" if self.force_amplitude_N is None else f"{self.force_amplitude_N:g} N"
        return [
            ("run", self.name),
            ("support", self.support),
            ("lines", f"{len(self.frequency_hz)}, {self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"),
            ("channels", ", ".join(map(str, self.channels))),
            ("force", f"{force} at node {self.excitation_node} along {self.excitation_plane}"),
            ("spin", f"{self.spin_rpm:g} rpm"),
        ]

    def check_nodes(self, n_nodes: int) -> None:
        """Raise MeasurementError where the exciter or an accelerometer is at a node that a rig of so many lacks."""
        places = [("excitation_node", self.excitation_node), *((f"channel {c}", c.node) for c in self.channels)]
        for label, node in places:
            if node > n_nodes:
                wrong = f"node {node} does not exist, the rig has {n_nodes}"
                raise MeasurementError(f"run {self.name!r}, {label}: {wrong}; correct one of them")

    @property
    def along_force(self) -> list[int]:
        """Places of the channels that read along the force."""
        return [place for place, channel in enumerate(self.channels) if channel.plane == self.excitation_plane]

    def at_order(self, order: int) -> Run:
        """The same run at ``order`` times its frequencies, where its harmonics of this order are, and with none."""
        swept = None if self.swept_hz is None else order * self.swept_hz
        return replace(self, frequency_hz=order * self.frequency_hz, swept_hz=swept, harmonics={})

    def on_lines(self, lines: NDArray[np.bool_] | slice) -> Run:
        """The same run with some of its lines; ``swept_hz`` keeps all lines that were swept."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[lines],
            H=self.H[lines],
            std=None if self.std is None else self.std[lines],
            harmonics={order: values[lines] for order, values in self.harmonics.items()},
            force_N=None if self.force_N is None else self.force_N[lines],
            swept_hz=self.frequency_hz if self.swept_hz is None else self.swept_hz,
        )

    @property
    def forces(self) -> FloatArray:
        """(n_freq,) peak force of each line [N]: as recorded, or the run's own; 1 where nobody knows it."""
        if self.force_N is not None:
            return self.force_N
        return np.full(len(self.frequency_hz), self.force_amplitude_N or 1.0)

    @property
    def levels(self) -> tuple[float, ...]:
        """Force levels that the run was made at [N]: one, both ends under response control, none where unknown."""
        if self.control == "response" and self.force_N is not None:
            return float(self.force_N.min()), float(self.force_N.max())
        return () if self.force_amplitude_N is None else (self.force_amplitude_N,)

    def at_force(self, factor: float) -> Run:
        """The same run under forces so many times as large; its response per newton stays."""
        if factor == 1:
            return self
        force = None if self.force_N is None else factor * self.force_N
        return replace(self, force_amplitude_N=factor * (self.force_amplitude_N or 1.0), force_N=force)

    def as_recorded(self, H: ComplexArray) -> np.ndarray:
        """A model's response (n_freq, n_channels) as this run holds its own: magnitudes where no phase was recorded."""
        return np.abs(H) if self.magnitude_only else H

    def with_channels(self, places: Sequence[int]) -> Run:
        """The same run with some of its channels, by their places."""
        some = list(places)
        return replace(
            self,
            H=self.H[:, some],
            channels=tuple(self.channels[i] for i in some),
            std=None if self.std is None else self.std[:, some],
            harmonics={order: harmonic[:, some] for order, harmonic in self.harmonics.items()},
        )

    def channel(self, node: int, plane: Plane = "y", label: str = "") -> ComplexArray:
        """(n_freq,) response of one channel. Raises MeasurementError when it was not measured."""
        wanted = Channel(node, plane, label)
        if wanted not in self.channels:
            there = ", ".join(map(str, self.channels))
            raise MeasurementError(f"run {self.name!r} has no channel {wanted}; it has {there}")
        return self.H[:, self.channels.index(wanted)]


@dataclass(frozen=True)
class PeakList:
    """Resonance frequencies read from a curve of which nothing else is available."""

    support: SupportKind
    frequencies_hz: FloatArray  # (n_peaks,)
    std_hz: FloatArray  # (n_peaks,)


# Standard deviations of the logarithm of a damping: of one that somebody states, and of one that nobody does.
STATED_DAMPING, UNKNOWN_DAMPING = 0.1, 0.7

# The same of the stiffness of a joint: a lap joint that was opened and bolted again comes back so differently.
USUAL_JOINT = 0.3

# Relative drift of a resonance from run to run where nobody states one.
USUAL_DRIFT = 1e-4


@dataclass(frozen=True)
class NominalBelief:
    """What the nominal model assumes about this rig before any diagnosis, and how well the workshop knows it.

    A tolerance is a relative standard deviation, that of a damping, a tilt stiffness or a joint one of the
    logarithm. A
    repeatability of None is learned from the runs.
    """

    shaft_damping_ratio: float = Condition.shaft_damping_ratio
    bearing_damping_Ns_per_m: float = 0.0
    gain_tolerance: float = 0.02  # of each run's force gain; that of each sensor's gain is half of it
    frequency_drift: float | None = None  # of a resonance from run to run
    gain_repeatability: float | None = None  # of a sensor's gain from run to run
    modulus_tolerance: float = 0.01
    disk_mass_tolerance: float = 0.005
    span_tolerance: float = 0.001
    shaft_damping_tolerance: float = STATED_DAMPING
    bearing_damping_tolerance: float = STATED_DAMPING
    tilt_tolerance: float = UNKNOWN_DAMPING  # of supports that hold the shaft's slope
    joint_tolerance: float = USUAL_JOINT  # of each joint's stiffness
    sensor_mass_kg: float = 0.0  # of every accelerometer that stays mounted

    @property
    def expected_drift(self) -> float:
        """The stated drift of a resonance from run to run, or a usual one where it is to be learned."""
        return USUAL_DRIFT if self.frequency_drift is None else self.frequency_drift


@dataclass(frozen=True)
class Campaign:
    """Everything measured on one rig."""

    title: str
    rig: str  # name of a shipped rig or path of a rig TOML
    runs: tuple[Run, ...] = ()
    peaks: tuple[PeakList, ...] = ()
    nominal: NominalBelief = NominalBelief()

    def check_nodes(self, n_nodes: int) -> None:
        """Raise MeasurementError where a run has a node that a rig of so many lacks."""
        for run in self.runs:
            run.check_nodes(n_nodes)

    def _repr_html_(self) -> str:
        """Its runs and lists of resonances, for notebooks."""
        runs = [[value for _, value in run._facts()] for run in self.runs]
        header = [name for name, _ in self.runs[0]._facts()] if self.runs else []
        peaks = [
            (p.support, ", ".join(f"{f:g} ± {s:g}" for f, s in zip(p.frequencies_hz, p.std_hz, strict=True)))
            for p in self.peaks
        ]
        return (
            html.paragraph(f"{self.title or 'Campaign'}, rig {self.rig}")
            + (html.table(header, runs) if runs else "")
            + (html.table(("support", "resonances, Hz"), peaks) if peaks else "")
        )
