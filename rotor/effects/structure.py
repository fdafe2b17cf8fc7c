"""Linear effects of shaft, disks and what hangs on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.effects.effect import Effect, node, parameter, position
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.design import Branch, Design


@dataclass(frozen=True)
class AttachedMass(Effect):
    """Something sits on the shaft that the model does not know: a coupling, a collar, a shaker's armature."""

    id = "attached_mass"
    title = "Attached mass"
    meaning = "the shaft carries a mass that the model lacks, like a collar, a coupling half or an exciter's armature"
    equation = (
        r"D(\omega) \to D(\omega) - \omega^2 \frac{m}{2} \sum_\pm N_w(x_n \pm b)^{T} N_w(x_n \pm b), \quad"
        r" b = 0\!: D(\omega) - \omega^2 m\, e_n e_n^{T}"
    )
    signature = "lowers the modes that have an antinode at the node; a wide mass also lowers those that tilt there"
    source = "ewins2000"
    location = "node"
    family = "structure"
    acts_at_once = True

    mass: float = parameter(0.1, "kg", "Attached mass", 0.004, 0.5, null=0.0, minimum=0.0, maximum=1e6, log=True)
    node: int = node(4, "Node at which the mass sits")
    half_width: float = parameter(
        0.0, "m", "Distance b from the node on each side at which half of the mass sits", 0.0, 0.07,
        minimum=0.0, maximum=10.0, form=True,
    )  # fmt: skip

    def add_to(self, design: Design) -> None:
        """M at the node, or in halves on both sides of it, y and z."""
        design.masses.append((self.node, self.mass, self.half_width))


def known_mass(mass: float, node: int) -> Effect:
    """What a mass [kg] does that a test clamps to a node on purpose."""
    return AttachedMass(mass=mass, node=node)


@dataclass(frozen=True)
class ExciterSuspension(Effect):
    """The exciter's drive rod ties the shaft to the ground."""

    id = "exciter_suspension"
    title = "Exciter suspension"
    meaning = "the suspension of the exciter's armature holds the shaft at the drive node"
    equation = r"D(\omega) \to D(\omega) + (k + i\omega c)\, e_d e_d^{T}"
    signature = "raises the modes that move at the drive node; changes when the exciter is moved"
    source = "ewins2000"
    location = "exciter"
    family = "structure"

    stiffness: float = parameter(
        3e4, "N/m", "Stiffness to ground at the drive node", 0.001, 1.0, null=0.0, minimum=0.0, maximum=1e12, log=True
    )
    damping: float = parameter(
        1.0, "N.s/m", "Damping to ground at the drive node", 0.0, 0.01, null=0.0, minimum=0.0, maximum=1e9
    )

    def add_to(self, design: Design) -> None:
        """A spring and a damper to ground where and along what the exciter acts."""
        condition = design.condition
        spring = (condition.excitation_node, condition.excitation_plane, self.stiffness, self.damping)
        design.ground_springs.append(spring)


@dataclass(frozen=True)
class DiskMass(Effect):
    """The disks are heavier or lighter than their drawing."""

    id = "disk_mass"
    title = "Disk mass"
    meaning = "the disks' mass differs from the model's"
    equation = r"m_d \to m_d (1 + \delta)"
    signature = "all modes that move at the disks shift in a similar way, much like with another shaft modulus"
    source = "friswell2010"
    location = "disks"
    family = "structure"
    acts_at_once = True

    change: float = parameter(
        0.03, "1", "Relative change of every disk's mass", -0.08, 0.08, null=0.0, minimum=-0.9, maximum=9.0
    )

    def add_to(self, design: Design) -> None:
        """M at the disks."""
        design.disk_mass_change += self.change


@dataclass(frozen=True)
class DiskInertia(Effect):
    """The disks resist tilting; the nominal model lumps their mass only."""

    id = "disk_inertia"
    title = "Diametral inertia of the disks"
    meaning = "the disks resist tilting; the nominal model has only their mass"
    equation = r"I_d\,\ddot\theta, \qquad I_d = \gamma\, \tfrac{m_d}{12}\left(\tfrac34 D^2 + t^2\right)"
    signature = "lowers the modes in which the disks tilt; modes with an antinode at the disks hardly change"
    source = "friswell2010"
    location = "disks"
    family = "structure"
    acts_at_once = True

    factor: float = parameter(
        1.0, "1", "Share of the solid disk's diametral inertia", 0.0, 2.0, null=0.0, minimum=0.0, maximum=10.0
    )

    def add_to(self, design: Design) -> None:
        """M at the disks' rotations."""
        design.disk_inertia_factor += self.factor


@dataclass(frozen=True)
class HubStiffening(Effect):
    """Inside a shrunk-on disk the shaft bends less."""

    id = "hub_stiffening"
    title = "Hub stiffening"
    meaning = "a pressed-on disk stiffens the shaft over the length of its hub"
    equation = r"EI(x) \to \beta\, EI(x), \quad |x - x_d| < t/2"
    signature = "raises the modes that bend the shaft at the disks"
    source = "friswell2010"
    location = "disks"
    family = "structure"
    needs_finer_mesh = True

    factor: float = parameter(
        1.5,
        "1",
        "Bending stiffness inside the hub divided by that of the bare shaft",
        1.0,
        2.5,
        null=1.0,
        minimum=0.1,
        maximum=100.0,
    )

    def add_to(self, design: Design) -> None:
        """The shaft's flexibility over the disks' thickness."""
        design.hub_factor *= self.factor


@dataclass(frozen=True)
class ShaftModulus(Effect):
    """The shaft's modulus is not the handbook's."""

    id = "shaft_modulus"
    title = "Shaft modulus"
    meaning = "the shaft's Young's modulus differs from the model's"
    equation = r"K_s \to \epsilon\, K_s"
    signature = "shifts all modes on rigid supports by the same ratio"
    source = "friswell2010"
    location = "shaft"
    family = "structure"

    factor: float = parameter(
        1.02, "1", "Young's modulus divided by that of the model", 0.9, 1.1, null=1.0, minimum=0.01, maximum=100.0
    )

    def add_to(self, design: Design) -> None:
        """The shaft's stiffness; Poisson's ratio stays."""
        design.modulus_factor *= self.factor


@dataclass(frozen=True)
class AxialLoad(Effect):
    """A pull or push along the shaft stiffens or softens its bending."""

    id = "axial_load"
    title = "Axial load"
    meaning = "an axial force makes the shaft stiffer (tension, positive) or softer in bending"
    equation = r"K \to K + P \int N_w'^{T} N_w'\,dx, \qquad \Delta f/f \approx P / (2 P_{cr})"
    signature = "tension raises the modes and compression lowers them, the lowest modes most"
    source = "przemieniecki1968"
    location = "shaft"
    family = "structure"

    force: float = parameter(
        2e3, "N", "Axial force, tension positive", -0.04, 0.04, null=0.0, minimum=-1e10, maximum=1e10
    )

    def add_to(self, design: Design) -> None:
        """Geometric stiffness of the whole shaft."""
        design.tension += self.force


@dataclass(frozen=True)
class OpenCrack(Effect):
    """A crack that stays open acts as a hinge with a spring."""

    id = "open_crack"
    title = "Open crack"
    meaning = "an open crack adds rotational compliance at one cross-section"
    equation = r"c = \frac{0.8\,d}{EI}\,\frac{r}{1 - r}: \quad \Delta\theta = c\, M(x_c)"
    signature = "lowers the modes that bend the shaft at the crack; modes without a bending moment there do not change"
    source = "dimarogonas1996"
    location = "position"
    family = "structure"
    needs_finer_mesh = True

    reduction: float = parameter(
        0.2,
        "1",
        "Share of the bending stiffness that is lost, over 0.8 diameters of shaft",
        0.05,
        0.6,
        null=0.0,
        minimum=0.0,
        maximum=0.99,
        log=True,
        starts=(0.3,),
    )
    position: float = position(0.2, "Position along the shaft")

    def add_to(self, design: Design) -> None:
        """The flexibility of the element the crack is in."""
        if not 0 <= self.position <= design.structure.x[-1] + 1e-9:
            raise ValueError(
                f"open_crack.position must lie on the shaft, 0 to {design.structure.x[-1]:g} m, got {self.position:g}"
            )
        if self.reduction:
            design.cracks.append((self.position, self.reduction))


@dataclass(frozen=True)
class ShaftDamping(Effect):
    """The shaft's own damping is not what the model believes."""

    id = "shaft_damping"
    title = "Shaft damping"
    meaning = "the damping of the shaft's material and joints differs from the model's"
    equation = r"\zeta \to \zeta': \quad C_s(\zeta')"
    signature = "the heights and widths of all shaft modes change; their frequencies do not"
    source = "crandall1970"
    location = "shaft"
    family = "structure"
    moves_resonances = False

    damping_ratio: float = parameter(
        0.005,
        "1",
        "Damping ratio of the shaft; it replaces the model's",
        0.001,
        0.02,
        null="shaft_damping_ratio",
        minimum=0.0,
        maximum=0.2,
        log=True,
    )

    def add_to(self, design: Design) -> None:
        """Replaces the shaft's damping ratio."""
        design.replace(self.id)
        design.shaft_damping_ratio = self.damping_ratio


# A mass that no rotor of any size notices; products of smaller ones leave the range of floating-point numbers [kg].
NO_MASS = 1e-20


@dataclass(frozen=True)
class MeasuredJoint(Effect):
    """Something at a node that no other effect describes, by the dynamic stiffness that was measured there.

    Between the node and the ground acts

        Z = k - omega^2 m + i omega c + D_r (i omega c_g - omega^2 m_r) / (D_r + i omega c_g - omega^2 m_r),

    in y and in z alike: a branch of a mass m_r on a spring and a damper, D_r = k_r + i omega c_r, to the node and on a
    damper c_g to the ground, with k_r = m_r w_r^2, c_r = 2 zeta_r w_r m_r, c_g = 2 zeta_g w_r m_r, w_r = 2 pi f_r. With
    little damping it is a resonance, with a large zeta_g a Maxwell element. No damper is negative, so that it never
    feeds power into the rotor. k is negative where something pulls the shaft away from its axis, as a magnet does; a
    rotor that has no stiffness left raises ValueError when it is solved. No mass is negative, as a shaft has none at a
    single point that could be missing.

    >>> MeasuredJoint(stiffness=1e4, node=3).start_values()["measured_joint.stiffness"]
    10000.0
    """

    id = "measured_joint"
    title = "Measured joint"
    meaning = "something unknown acts at a node, by a dynamic stiffness to the ground that was fitted to measurements"
    equation = (
        r"D(\omega) \to D(\omega) + Z\, e_n e_n^{T}, \quad Z = k - \omega^2 m + i\omega c +"
        r"\frac{D_r\,(i\omega c_g - \omega^2 m_r)}{D_r + i\omega c_g - \omega^2 m_r}, \quad"
        r" D_r = m_r (\omega_r^2 + 2 i \zeta_r \omega_r \omega), \; c_g = 2 \zeta_g \omega_r m_r, \;"
        r" \omega_r = 2\pi f_r"
    )
    signature = "modes that move at the node shift and widen; near the branch's frequency a further resonance appears"
    source = "ren1995"
    location = "node"
    family = "structure"
    is_candidate = False
    acts_at_once = True
    changes_size = True

    stiffness: float = parameter(
        5e4, "N/m", "Stiffness k to the ground", -0.1, 1.0, null=0.0, minimum=-1e12, maximum=1e12
    )
    mass: float = parameter(0.02, "kg", "Mass m", 0.0, 0.2, null=0.0, minimum=0.0, maximum=1e6)
    damping: float = parameter(5.0, "N.s/m", "Damping c to the ground", 0.0, 0.05, null=0.0, minimum=0.0, maximum=1e9)
    node: int = node(4, "Node at which it acts, 0: the exciter's, wherever that is", exciter=True)
    branch_mass: float = parameter(
        0.0, "kg", "Mass m_r of the branch; 0: no branch", 0.0, 0.5, null=0.0, minimum=0.0, maximum=1e6, form=True
    )
    branch_frequency: float = parameter(
        200.0, "Hz", "Natural frequency f_r of the branch while its node is held", 0.02, 3.0, minimum=1e-3, maximum=1e6,
        log=True, form=True,
    )  # fmt: skip
    branch_damping_ratio: float = parameter(
        0.02, "1", "Damping ratio zeta_r beside the branch's spring", 0.001, 5.0, minimum=0.0, maximum=1e4, log=True,
        form=True,
    )  # fmt: skip
    branch_ground_ratio: float = parameter(
        0.001, "1", "Damping ratio zeta_g between the branch's mass and the ground", 1e-5, 5.0, minimum=0.0,
        maximum=1e4, log=True, form=True,
    )  # fmt: skip

    def add_to(self, design: Design) -> None:
        """A mass, springs and dampers to ground in y and z, and the branch where it has a mass."""
        at = self.node or design.condition.excitation_node
        design.masses.append((at, self.mass, 0.0))
        design.ground_springs += [(at, plane, self.stiffness, self.damping) for plane in (1, 2)]
        if self.branch_mass > NO_MASS:
            omega = 2 * np.pi * self.branch_frequency
            damping = 2 * omega * self.branch_mass
            spring = omega**2 * self.branch_mass, self.branch_damping_ratio * damping
            design.branches.append(Branch(at, self.branch_mass, *spring, self.branch_ground_ratio * damping))

    def dynamic_stiffness(self, omega: FloatArray) -> ComplexArray:
        """(n_freq,) Z [N/m] at angular frequencies [rad/s]."""
        s, own = 1j * np.asarray(omega), 2 * np.pi * self.branch_frequency
        spring = own**2 + 2 * self.branch_damping_ratio * own * s  # per kilogram of the branch's mass
        body = s**2 + 2 * self.branch_ground_ratio * own * s
        return self.stiffness + s**2 * self.mass + s * self.damping + self.branch_mass * spring * body / (spring + body)
