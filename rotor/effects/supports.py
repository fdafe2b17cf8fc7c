"""Linear effects of the bearings and of what they stand on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.effects.effect import MANY_STARTS, Effect, parameter
from rigtwin.rotor.model.design import WEAKEST_BRANCH, Design, Pedestal

# Maxwell branches of a bearing's seat whose relaxation times differ: an odd number, the middle ones strongest.
BRANCHES = 5


@dataclass(frozen=True)
class BearingDamping(Effect):
    """The bearings damp more, or less, than the model believes."""

    id = "bearing_damping"
    title = "Bearing damping"
    meaning = "the viscous damping of the bearings differs from the model's"
    equation = r"D_b(\omega) = k_b + i\omega c_b"
    signature = "widens the modes in which the bearings move; changes nothing on rigid supports"
    source = "kramer1993"
    location = "bearings"
    family = "support"
    moves_resonances = False

    damping: float = parameter(
        100.0,
        "N.s/m",
        "Damping of each bearing; it replaces the model's",
        0.002,
        0.4,
        null="bearing_damping",
        minimum=0.0,
        maximum=1e9,
        log=True,
    )

    def add_to(self, design: Design) -> None:
        """Replaces the bearings' damping."""
        design.replace(self.id)
        for bearing in design.bearings:
            bearing.damping = self.damping


@dataclass(frozen=True)
class BearingTiltStiffness(Effect):
    """A double-row or wide bearing resists tilting."""

    id = "bearing_tilt_stiffness"
    title = "Bearing tilt stiffness"
    meaning = "the bearings resist tilting of the shaft, as double-row bearings do"
    equation = r"M = k_\theta\, \theta"
    signature = "raises the modes, the first one most when k_b is stiff; changes nothing on rigid supports"
    source = "lim1990"
    location = "bearings"
    family = "support"

    stiffness: float = parameter(
        2e3, "N.m/rad", "Tilt stiffness of each bearing", 0.0004, 0.07, null=0.0, minimum=0.0, maximum=1e12, log=True
    )

    def add_to(self, design: Design) -> None:
        """A rotational spring to ground at every bearing."""
        for bearing in design.bearings:
            bearing.tilt_stiffness += self.stiffness


@dataclass(frozen=True)
class PedestalFlexibility(Effect):
    """The bearing housing stands on something that moves."""

    id = "pedestal_flexibility"
    title = "Pedestal flexibility"
    meaning = "every bearing stands on a pedestal with mass, stiffness and damping; the pedestal may stand on a block"
    equation = (
        r"D_b(\omega) = \frac{k_b D_p}{k_b + D_p}, \; D_p = k_p - \omega^2 m_p + i\omega c_p; \qquad \beta > 0: \; "
        r"D_p = -\omega^2 m_p + \frac{(k_p + i\omega c_p) D_f}{k_p + i\omega c_p + D_f}, \; "
        r"D_f = k_p/\beta - \omega^2 \mu m_p"
    )
    signature = "bearings seem softer below the pedestal's resonance; near it, a further pole and antiresonance appear"
    source = "friswell2010"
    location = "bearings"
    family = "support"
    changes_size = True

    stiffness: float = parameter(
        1e7,
        "N/m",
        "Stiffness of each pedestal",
        0.3,
        50.0,
        null=np.inf,
        minimum=1.0,
        maximum=1e15,
        log=True,
        starts=MANY_STARTS,
    )
    mass: float = parameter(
        1.0,
        "kg",
        "Moving mass of each pedestal",
        0.05,
        3.0,
        minimum=1e-6,
        maximum=1e7,
        log=True,
        starts=(0.15, 0.5, 0.85),
    )
    damping: float = parameter(
        50.0, "N.s/m", "Damping of each pedestal", 0.0002, 0.5, minimum=0.0, maximum=1e9, log=True
    )
    block_compliance: float = parameter(
        0.0,
        "1",
        "Compliance beta under the block of each pedestal, relative to the pedestal's; 0: no block",
        0.0,
        0.5,
        minimum=0.0,
        maximum=1e3,
        form=True,
    )
    block_mass: float = parameter(
        8.0,
        "1",
        "Mass mu of that block, relative to the pedestal's",
        2.0,
        30.0,
        minimum=1e-3,
        maximum=1e6,
        log=True,
        form=True,
    )

    def add_to(self, design: Design) -> None:
        """A mass on a spring and a damper, in y and z, under every bearing; below them the ground, or a block."""
        design.replace(self.id)
        pedestal = Pedestal(self.stiffness, self.mass, self.damping, self.block_compliance, self.block_mass)
        for bearing in design.bearings:
            bearing.pedestal = pedestal


@dataclass(frozen=True)
class BearingAsymmetry(Effect):
    """The two bearings are not alike."""

    id = "bearing_asymmetry"
    title = "Unequal bearings"
    meaning = "the left bearing is stiffer (positive) or softer than the right one"
    equation = r"k_L = k_b (1 + a), \quad k_R = k_b (1 - a)"
    signature = "mixes symmetric and antisymmetric modes, so that the two ends move with different amplitudes"
    source = "friswell2010"
    location = "bearings"
    family = "support"

    asymmetry: float = parameter(
        0.2,
        "1",
        "Relative difference of the left bearing's stiffness from the mean",
        -0.5,
        0.5,
        null=0.0,
        minimum=-0.99,
        maximum=0.99,
    )

    def add_to(self, design: Design) -> None:
        """k_b of every bearing by its side."""
        for bearing in design.bearings:
            bearing.stiffness *= 1 - bearing.side * self.asymmetry


@dataclass(frozen=True)
class BearingOffset(Effect):
    """The force acts beside the bearing's middle: the effective span differs from the drawing's."""

    id = "bearing_offset"
    title = "Bearing offset"
    meaning = "every bearing acts beside its node, towards the middle of the rotor (positive) or away from it"
    equation = r"D(\omega) \to \ldots + D_b(\omega)\, N_w(x_b)^{T} N_w(x_b), \quad x_b = x_{node} \pm o"
    signature = "all modes shift as with another span; changes nothing on rigid supports"
    source = "przemieniecki1968"
    location = "bearings"
    family = "support"

    offset: float = parameter(
        0.003, "m", "Shift of each bearing towards the middle", -0.025, 0.025, null=0.0, minimum=-10.0, maximum=10.0
    )

    def add_to(self, design: Design) -> None:
        """Where the bearings act on the shaft."""
        for bearing in design.bearings:
            bearing.x -= bearing.side * self.offset


@dataclass(frozen=True)
class CompliantRigidSupport(Effect):
    """A support that is called rigid gives way."""

    id = "compliant_rigid_support"
    title = "Compliant rigid support"
    meaning = "the rigid supports, which replace the bearings, have a finite stiffness"
    equation = r"q_{support} = 0 \;\to\; f = k_r\, q_{support}"
    signature = "lowers the modes on rigid supports; changes nothing on bearings"
    source = "ewins2000"
    location = "rigid_support"
    family = "support"
    acts_at_once = True
    changes_size = True

    stiffness: float = parameter(
        1e8, "N/m", "Stiffness of each rigid support", 3.0, 100000.0, null=np.inf, minimum=1.0, maximum=1e18, log=True
    )

    def add_to(self, design: Design) -> None:
        """Gives the held degrees of freedom back, on springs; two such springs sit in series."""
        design.rigid_stiffness = 1 / (1 / design.rigid_stiffness + 1 / self.stiffness)


@dataclass(frozen=True)
class PlaneAnisotropy(Effect):
    """The bearings are stiffer along one axis than across it."""

    id = "plane_anisotropy"
    title = "Anisotropic bearings"
    meaning = "the bearings are stiffer in one direction than perpendicular to it; both may be turned against y and z"
    equation = r"K_b = k_b\, R(\alpha)\, \mathrm{diag}(1 + \tfrac a2,\; 1 - \tfrac a2)\, R(\alpha)^{T}"
    signature = "pairs of peaks appear, and the rotor also moves perpendicular to the force"
    source = "friswell2010"
    location = "bearings"
    family = "support"
    couples_planes = True

    anisotropy: float = parameter(
        0.2,
        "1",
        "Difference of the two stiffnesses divided by their mean",
        0.1,
        0.5,
        null=0.0,
        minimum=-1.9,
        maximum=1.9,
    )
    angle: float = parameter(
        0.35,
        "rad",
        "Angle of the stiffer direction, from y towards z",
        -1.5708,
        1.5708,
        minimum=-3.2,
        maximum=3.2,
        starts=(0.15, 0.35, 0.65, 0.85),
        sign_seen_across=True,
    )

    def add_to(self, design: Design) -> None:
        """The bearings' stiffness matrix in (y, z): what this adds to the mean."""
        c, s = np.cos(2 * self.angle), np.sin(2 * self.angle)
        for bearing in design.bearings:
            bearing.directions = bearing.directions + self.anisotropy / 2 * np.array([[c, s], [s, -c]])


@dataclass(frozen=True)
class ViscoelasticSupport(Effect):
    """Rubber, grease or an O-ring: stiffness and loss depend on frequency."""

    id = "viscoelastic_support"
    title = "Viscoelastic support"
    meaning = "the bearings' seat is viscoelastic: springs in series with dashpots (Maxwell branches) act beside k_b"
    equation = (
        r"D_b(\omega) = k_b \left(1 + g\,\frac{i\omega\tau}{1 + i\omega\tau}\right); \qquad s > 0: \; "
        r"D_b = k_b \left(1 + \sum_{j=1}^{n} g_j\,\frac{i\omega\tau_j}{1 + i\omega\tau_j}\right), \; "
        rf"n = {BRANCHES}, \; \tau_j = \tau\, 10^{{s (2j - n - 1)/(n - 1)}}, \; "
        r"g_j = g\, \frac{\min(j, n + 1 - j)}{((n + 1)/2)^2}"
    )
    signature = "modes above 1/(2 pi tau) are stiffer than those below; the damping is largest near that frequency"
    source = "christensen1982"
    location = "bearings"
    family = "support"
    changes_size = True

    strength: float = parameter(
        0.5, "1", "Stiffness of the branch divided by k_b", 0.1, 2.0, null=0.0, minimum=0.0, maximum=1e3, log=True
    )
    relaxation_time: float = parameter(
        1e-3, "s", "Relaxation time of the branch", 0.05, 8.0, minimum=1e-7, maximum=1e3, log=True, starts=(0.3, 0.7)
    )
    spread: float = parameter(
        0.0,
        "1",
        "Spread s of the relaxation times of several branches, in decades to either side; 0: one branch",
        0.0,
        1.5,
        minimum=0.0,
        maximum=3.0,
        form=True,
        starts=(0.3, 0.7),
    )

    def add_to(self, design: Design) -> None:
        """Springs in series with dashpots beside the bearings' stiffness, one or several; their joints have no mass."""
        strength = max(self.strength, WEAKEST_BRANCH)  # tuned to zero while the rotor runs, the joint is still there
        n = BRANCHES if self.spread else 1
        j = np.arange(1, n + 1)
        shares = np.minimum(j, n + 1 - j) / ((n + 1) / 2) ** 2
        times = self.relaxation_time * 10.0 ** (self.spread * (2 * j - n - 1) / max(n - 1, 1))
        for bearing in design.bearings:
            bearing.branches += zip(strength * shares, times, strict=True)
