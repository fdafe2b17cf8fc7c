"""Effects of the measurement chain: sensors, exciter, and how the sweep is run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.effects.effect import MANY_STARTS, Effect, node, parameter
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.design import Design


@dataclass(frozen=True)
class SensorGain(Effect):
    """A wrong sensitivity.

    >>> SensorGain(gain=1.1, node=2).channel_factor(np.array([100.0]), channel_node=2)
    array([1.1+0.j])
    """

    id = "sensor_gain"
    title = "Sensor gain"
    meaning = "the sensitivity of a sensor differs from the value that the evaluation uses"
    equation = r"H_{sd} \to \gamma\, H_{sd}"
    signature = "one channel is too large or too small by one factor at every frequency; the poles do not change"
    source = "ewins2000"
    location = "sensor"
    family = "chain"
    in_fmu = False
    common_is_calibrated = True

    gain: float = parameter(1.1, "1", "Reported acceleration / true one", 0.8, 1.2, null=1.0, minimum=-1e3, maximum=1e3)
    node: int = node(2, "Node of the sensor, 0: every sensor", all_nodes=True)

    def channel_factor(self, omega: FloatArray, channel_node: int) -> ComplexArray:
        """The gain, at its sensor."""
        return np.full(len(omega), self.gain if self.node in (0, channel_node) else 1.0, dtype=complex)


@dataclass(frozen=True)
class SensorDelay(Effect):
    """The response channels are delayed relative to the force channel."""

    id = "sensor_delay"
    title = "Sensor delay"
    meaning = "the response is sampled later than the force"
    equation = r"H_{sd} \to e^{-i\omega T} H_{sd}"
    signature = "the phase falls in proportion to the frequency; magnitudes and poles do not change"
    source = "ewins2000"
    location = "sensor"
    family = "chain"
    in_fmu = False
    needs_phase = True

    delay: float = parameter(
        2e-4,
        "s",
        "Delay of the response against the force",
        -1.3,
        1.3,
        null=0.0,
        minimum=-1.0,
        maximum=1.0,
        starts=MANY_STARTS,
    )
    node: int = node(0, "Node of the sensor, 0: every sensor", all_nodes=True)

    def channel_factor(self, omega: FloatArray, channel_node: int) -> ComplexArray:
        """e^{-i omega T}, at its sensor."""
        late = np.exp(-1j * np.asarray(omega) * self.delay)
        return late if self.node in (0, channel_node) else np.ones_like(late)


@dataclass(frozen=True)
class SensorMass(Effect):
    """The accelerometer loads the rotor where it reads it."""

    id = "sensor_mass"
    title = "Sensor mass"
    meaning = "the accelerometer's mass loads the rotor where it reads; it is moved from node to node"
    equation = (
        r"M \to M + m_s\, e_s e_s^\mathsf{T} \text{ for channel } s, \quad"
        r" H_{sd} \approx \frac{H_{sd}}{1 - \omega^2 m_s H_{ss}} \text{ (the shaft's damping follows the loaded modes)}"
    )
    signature = "poles and antiresonances shift, by a different amount in each channel"
    source = "ewins2000"
    location = "sensor"
    family = "chain"
    acts_at_once = True
    rides_on_sensor = True

    mass: float = parameter(
        0.02, "kg", "Mass of the accelerometer", 0.001, 0.02, null=0.0, minimum=0.0, maximum=1e6, log=True
    )
    node: int = node(2, "Node of the sensor, 0: every sensor in turn", all_nodes=True)

    def add_to(self, design: Design) -> None:
        """A mass at the node; for every sensor in turn, see ``rotor.frequency.measured.channel_groups``."""
        if self.node:
            design.masses.append((self.node, self.mass, 0.0))


@dataclass(frozen=True)
class SensorPosition(Effect):
    """The accelerometer sits beside its node."""

    id = "sensor_position"
    title = "Sensor position"
    meaning = "the accelerometer sits beside its node and measures the motion there"
    equation = r"H_{sd} \to N_w(x_s + \delta)\, H_{\cdot d}"
    signature = "the antiresonances of one channel shift; the poles do not change"
    source = "ewins2000"
    location = "sensor"
    family = "chain"
    acts_at_once = True
    reads_beside_node = True

    offset: float = parameter(
        0.005, "m", "Distance from the node along x", -0.025, 0.025, null=0.0, minimum=-10.0, maximum=10.0
    )
    node: int = node(2, "Node of the sensor, 0: every sensor", all_nodes=True)

    def add_to(self, design: Design) -> None:
        """What the accelerometer reads."""
        nodes = range(1, design.structure.n_nodes + 1) if self.node == 0 else (self.node,)
        for number in nodes:
            design.structure.dof(number, 1)  # raises where there is no such node
            design.sensor_offsets[number] = design.sensor_offsets.get(number, 0.0) + self.offset


@dataclass(frozen=True)
class ForceDropout(Effect):
    """An exciter at constant current gives less force where the rotor moves much."""

    id = "force_dropout"
    title = "Force drop-out"
    meaning = "the exciter runs at constant current; its armature moves, so the force is not constant as assumed"
    equation = (
        r"F = \frac{F_0}{1 + Z_a Y_{dd}}, \quad "
        r"Z_a v = \left(k_a - \omega^2 m_a + \frac{i\omega c_a}{1 + i\omega\tau}\right) x"
    )
    signature = "resonances are flattened and shifted when the response is divided by the nominal force"
    source = "ewins2000"
    location = "exciter"
    family = "chain"
    in_fmu = False
    needs_exciter_current = True

    mass: float = parameter(
        0.1,
        "kg",
        "Moving mass of the exciter",
        0.004,
        0.2,
        null=0.0,
        minimum=0.0,
        maximum=1e6,
        log=True,
        starts=MANY_STARTS,
    )
    stiffness: float = parameter(
        1e4, "N/m", "Suspension of the exciter", 0.0005, 0.1, null=0.0, minimum=0.0, maximum=1e12, log=True
    )
    damping: float = parameter(
        5.0, "N.s/m", "Damping of the exciter, back EMF included", 0.0, 0.02, null=0.0, minimum=0.0, maximum=1e9
    )
    time_constant: float = parameter(
        0.0,
        "s",
        "Time constant L/R of the coil, which delays the damping by the back EMF",
        0.0,
        1.3,
        minimum=0.0,
        maximum=1.0,
        form=True,
    )

    def force_factor(self, omega: FloatArray, drive_receptance: ComplexArray) -> ComplexArray:
        """1 / (1 + (k_a + i omega c_a / (1 + i omega tau) - omega^2 m_a) H_dd)."""
        w = np.asarray(omega, dtype=float)
        braking = 1j * w * self.damping / (1 + 1j * w * self.time_constant)
        return 1 / (1 + (self.stiffness + braking - w**2 * self.mass) * drive_receptance)


@dataclass(frozen=True)
class CoarseGrid(Effect):
    """Frequency steps wider than the resonance."""

    id = "coarse_grid"
    title = "Coarse frequency raster"
    meaning = "the frequency lines are further apart than the half-power bandwidth"
    equation = r"\Delta f > 2\zeta f_r"
    signature = "the heights of peaks are irregular and always too low; the values on the lines are right"
    source = "ewins2000"
    location = "raster"
    family = "chain"
    in_fmu = False
    moves_response = False
    remedy = "Repeat the runs with lines as close together as the audit asks for under raster: then the peaks show."

    step: float = parameter(1.0, "Hz", "Distance between the lines", 0.0003, 0.02, minimum=1e-4, maximum=1e3, log=True)

    def sweep_changes(self) -> Mapping[str, float]:
        """An even raster without refinement."""
        return {"step_hz": self.step}


@dataclass(frozen=True)
class FastSweep(Effect):
    """Lines are read before the rotor has settled."""

    id = "fast_sweep"
    title = "Fast sweep"
    meaning = "every line is read a fixed time after its frequency was set, even if the motion has not settled"
    equation = r"t_{dwell} < \frac{1}{\zeta\,\omega_r}"
    signature = "peaks are too low and come too late in the direction of the sweep; lines behind a peak scatter"
    source = "ewins2000"
    location = "raster"
    family = "chain"
    in_fmu = False
    remedy = (
        "Repeat the runs and stay longer at each line near the resonances, until the response has settled: "
        "then peaks are as high as they are, and where they are."
    )

    dwell: float = parameter(
        0.5,
        "s",
        "Time between setting a frequency and reading it",
        30.0,
        3200.0,
        null=np.inf,
        minimum=1e-3,
        maximum=1e9,
        log=True,
        step=1e-10,
    )

    def sweep_changes(self) -> Mapping[str, float]:
        """A fixed dwell time without waiting for steady state."""
        return {"dwell_s": self.dwell}
