"""Local nonlinear effects: force laws of ``rotor.model.force_laws`` at the bearings, at a node or in the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.effects.effect import Effect, node, parameter
from rigtwin.rotor.model.design import Design, JointLaw
from rigtwin.rotor.model.force_laws import BILINEAR, CLEARANCE, CONTACT, CUBIC, HERTZ, JENKINS, SPRING

# Length over which a sharp corner of a law is rounded, relative to the law's own length: far below
# anything a measurement sees, far above round-off.
SHARP = 1e-6

# The same for a law without a length of its own [m].
SHARP_LENGTH = 1e-12

# Parts of a bearing's seat that slip one after another [iwan1966].
SEAT_PARTS = 5

# Parts of a joint that slip one after another, and the ratio of the angles at which two neighbours do. Within these
# parts the joint loses as much as a continuous law to within 15 %.
JOINT_PARTS, JOINT_RATIO = 16, 1.5


@dataclass(frozen=True)
class BearingCubic(Effect):
    """The bearings harden with the cube of the displacement."""

    id = "bearing_cubic"
    title = "Cubic bearing stiffness"
    meaning = "the bearings' restoring force has a part that grows with the cube of the displacement"
    equation = r"f = k_b x + k_3 x^3, \qquad f_r^2 \approx f_0^2\left(1 + \tfrac{3 k_3 a^2}{4 k_b}\right)"
    signature = "with more force, peaks bend to higher frequencies, jumps occur and a third harmonic appears"
    source = "nayfeh1979"
    location = "bearings"
    family = "nonlinear"
    stiffness_at_rest = (1.0, 0.95)

    stiffness: float = parameter(
        1e15,
        "N/m3",
        "Cubic stiffness k_3 of each bearing",
        1000000.0,
        10000000000.0,
        amplitude=-2,
        null=0.0,
        minimum=0.0,
        maximum=1e22,
        log=True,
        grid=14,
    )

    def add_to(self, design: Design) -> None:
        """k_3 x^3 at every bearing."""
        for bearing in design.bearings:
            bearing.laws.append(JointLaw(CUBIC, lambda _: (self.stiffness,)))


@dataclass(frozen=True)
class BearingHertz(Effect):
    """Hertzian contacts on both sides, pressed together by a preload that vibration can lift off."""

    id = "bearing_hertz"
    title = "Hertzian contact"
    meaning = "rolling contacts on both sides, preloaded by the approach d0, follow Hertz' law and can lift off"
    equation = r"f = K\left[(d_0 + x)_+^{3/2} - (d_0 - x)_+^{3/2}\right], \quad K = k_b / (3\sqrt{d_0})"
    signature = "softens with more force until the preload is lost, then hardens"
    source = "harris2006"
    location = "bearings"
    family = "nonlinear"
    stiffness_at_rest = (1.0, 1.05, 1.1)

    preload: float = parameter(
        5e-6,
        "m",
        "Approach d0 of the contacts under the preload",
        2.3e-06,
        5e-05,
        amplitude=1,
        null=np.inf,
        minimum=1e-9,
        maximum=1e3,
        log=True,
        grid=10,
    )

    def add_to(self, design: Design) -> None:
        """Takes the place of k_b, which is its slope at rest."""
        for bearing in design.bearings:
            bearing.laws.append(JointLaw(HERTZ, lambda k: (k, self.preload, SHARP * self.preload)))


@dataclass(frozen=True)
class BearingClearance(Effect):
    """The shaft is free within a gap before the bearing carries it."""

    id = "bearing_clearance"
    title = "Bearing clearance"
    meaning = "the shaft moves freely within a radial gap before the bearing carries it"
    equation = r"f = k_b\,(|x| - g)_+\,\mathrm{sign}\,x"
    signature = "soft at low force and stiffer with more; jumps and odd harmonics; the motion is often not periodic"
    source = "kahraman1990"
    location = "bearings"
    family = "nonlinear"
    stiffness_at_rest = (1.0, 1.06)
    acts_beyond_amplitude = True

    gap: float = parameter(
        2e-6,
        "m",
        "Radial gap g",
        1.1e-06,
        3.5e-05,
        amplitude=1,
        null=0.0,
        minimum=0.0,
        maximum=0.01,
        log=True,
        vague=True,
    )
    preload: float = parameter(
        0.0,
        "N",
        "Static load in y on each bearing, for example by gravity",
        0.0,
        0.00014,
        amplitude=1,
        minimum=0.0,
        maximum=1e9,
    )

    def add_to(self, design: Design) -> None:
        """Takes the place of k_b; a static load pushes the shaft through the gap."""
        if not self.gap:
            return
        for bearing in design.bearings:
            bearing.laws.append(
                JointLaw(
                    CLEARANCE,
                    coefficients=lambda k: (k, self.gap, SHARP * self.gap),
                    offset=lambda k: self.gap + self.preload / k if self.preload else 0.0,
                )
            )


@dataclass(frozen=True)
class BearingFriction(Effect):
    """The bearing's seat sticks and slips."""

    id = "bearing_friction"
    title = "Dry friction at the bearing seat"
    meaning = "the bearing seat sticks elastically up to a force limit and then slips, all at once or part by part"
    equation = (
        r"\dot f = k_t\,\dot x \;\text{ while } |f| < F_c, \quad |f| \le F_c;"
        r"\qquad s > 0: \; f = \textstyle\sum_{i=1}^{n} f_i, \; "
        r"k_i = \tfrac{k_t}{n}, \; F_i = \tfrac{F_c}{n}\left[1 + s\left(\tfrac{2i-1}{n} - 1\right)\right], \; "
        rf"n = {SEAT_PARTS}"
    )
    signature = "stiff and little damped at low force, most damped at medium force, less damped again at high force"
    source = "iwan1966"
    location = "bearings"
    family = "nonlinear"
    shares_k_b = True

    force: float = parameter(
        5.0,
        "N",
        "Friction limit of each bearing",
        1.3e-07,
        7e-05,
        amplitude=1,
        null=0.0,
        minimum=0.0,
        maximum=1e9,
        log=True,
        grid=10,
    )
    stiffness: float = parameter(
        1e7, "N/m", "Stiffness of the sticking seat", 0.05, 60.0, minimum=1.0, maximum=1e12, log=True, grid=5
    )
    spread: float = parameter(
        0.0,
        "1",
        "Spread s of the friction limits of the seat's parts; 0: all of it slips at once",
        0.0,
        1.0,
        minimum=0.0,
        maximum=1.0,
        form=True,
    )

    def add_to(self, design: Design) -> None:
        """Jenkins elements beside k_b at every bearing, in y and in z: one, or several that slip one after another."""
        if not self.force:
            return
        n = SEAT_PARTS if self.spread else 1
        for bearing in design.bearings:
            for part in range(n):
                share = (1 + self.spread * ((2 * part + 1) / n - 1)) / n
                bearing.laws.append(JointLaw(JENKINS, lambda _, share=share: (self.stiffness / n, share * self.force)))


@dataclass(frozen=True)
class BilinearSupport(Effect):
    """A support that is stiffer pushed than pulled."""

    id = "bilinear_support"
    title = "Bilinear support"
    meaning = "the bearings are stiffer in one direction (positive) than in the other, as with a loose housing cap"
    equation = r"f = k_b x\;(x < 0), \quad f = \rho\, k_b x\;(x > 0), \qquad f_r = \frac{2 f_+ f_-}{f_+ + f_-}"
    signature = "even harmonics and a mean displacement at every force; the resonance does not shift with the force"
    source = "shaw1983"
    location = "bearings"
    family = "nonlinear"

    ratio: float = parameter(
        1.5,
        "1",
        "Stiffness for positive displacement divided by that for negative",
        1.1,
        3.0,
        null=1.0,
        minimum=0.01,
        maximum=1e3,
        log=True,
    )

    def add_to(self, design: Design) -> None:
        """(rho - 1) k_b x where x is positive."""
        for bearing in design.bearings:
            bearing.laws.append(JointLaw(BILINEAR, lambda k: (k, self.ratio, SHARP_LENGTH)))


@dataclass(frozen=True)
class Rub(Effect):
    """The shaft touches a seal or a guard."""

    id = "rub"
    title = "Rub"
    meaning = "the shaft touches a stator at a node once it has crossed a gap"
    equation = r"f = k_s\,(|x| - g)_+\,\mathrm{sign}\,x"
    signature = "the peak is cut off above a certain displacement and bends to higher frequencies"
    source = "muszynska1989"
    location = "node"
    family = "nonlinear"
    acts_beyond_amplitude = True

    stiffness: float = parameter(
        1e6,
        "N/m",
        "Stiffness of the stator",
        0.05,
        60.0,
        null=0.0,
        minimum=0.0,
        maximum=1e12,
        log=True,
        motion_power=-2,
    )
    gap: float = parameter(
        5e-5,
        "m",
        "Gap between shaft and stator",
        2.3e-05,
        0.0005,
        amplitude=1,
        minimum=1e-9,
        maximum=0.1,
        log=True,
        motion_power=1,
    )
    node: int = node(4, "Node at which the rub happens")

    def add_to(self, design: Design) -> None:
        """A contact between the node and the ground, along the resultant of y and z."""
        if self.stiffness:
            law = JointLaw(CONTACT, lambda _: (self.stiffness, self.gap, SHARP * self.gap))
            design.contacts.append((self.node, law))


@dataclass(frozen=True)
class JointMicroslip(Effect):
    """The parts of a bolted joint slip one after another, the more of them the more it opens."""

    id = "joint_microslip"
    title = "Microslip in joints"
    meaning = "the parts of every joint of the rig slip one after another; a second contact may close at larger angles"
    equation = (
        r"M = \sum_{i=1}^{n} M_i + c\,k\,(|\theta| - g)_+\,\mathrm{sign}\,\theta, \qquad"
        r" \dot M_i = k_i\,\dot\theta \;\text{ while } |M_i| < k_i \theta_i, \quad |M_i| \le k_i \theta_i;"
        rf"\qquad \theta_i = \theta_s\, {JOINT_RATIO}^{{1 - i}}, \quad"
        r" \textstyle\sum_{\theta_j \le \theta_i} k_j \approx k\,(\theta_i / \theta_s)^{p}, \quad"
        rf" n = {JOINT_PARTS}"
    )
    signature = "with more force, damping grows and frequencies fall; they rise again where a second contact closes"
    source = "segalman2005"
    location = "joints"
    family = "nonlinear"

    angle: float = parameter(
        0.03,
        "rad",
        "Angle theta_s of the joint at which all of it slips",
        1e-5,
        0.1,
        amplitude=1,
        null=np.inf,
        minimum=1e-9,
        maximum=1e6,
        log=True,
    )
    exponent: float = parameter(
        1.0, "1", "Power p of the angle with which the loss factor grows", 0.5, 2.0, minimum=0.1, maximum=5.0, log=True
    )
    contact: float = parameter(
        0.0,
        "1",
        "Stiffness c of the second contact over that of the joint; 0: there is none",
        0.0,
        0.5,
        null=0.0,
        minimum=0.0,
        maximum=100.0,
    )
    gap: float = parameter(
        1e-3,
        "rad",
        "Angle g at which the second contact closes",
        1e-6,
        0.01,
        amplitude=1,
        minimum=1e-9,
        maximum=10.0,
        log=True,
    )

    def add_to(self, design: Design) -> None:
        """Jenkins elements in the place of every joint's tilt stiffness, and a contact beside them, in y and in z."""
        lower = [JOINT_RATIO ** (-0.5 - part) for part in range(JOINT_PARTS - 1)]
        borders = np.array([1.0, *lower, 0.0])  # of the parts' limits, over that of the last one to slip
        shares = -np.diff(borders**self.exponent)
        for part, share in enumerate(shares.tolist()):
            limit = self.angle * JOINT_RATIO**-part
            law = JointLaw(JENKINS, lambda k, share=share, limit=limit: (share * k, share * k * limit))
            design.joint_laws.append(law)
        design.joint_laws.append(JointLaw(SPRING, lambda k: (-k,)))
        if self.contact:
            design.joint_laws.append(JointLaw(CONTACT, lambda k: (self.contact * k, self.gap, SHARP * self.gap)))
