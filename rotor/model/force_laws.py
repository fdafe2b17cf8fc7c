"""Local force laws, each written once, as an expression.

``python build_laws.py`` prints every law's force and derivatives for floats and for arrays into
``printed_laws.py``, and in C into ``fmu_src/native/laws.[hc]``; nothing is written twice by hand. A law gives the
restoring force of a joint *in addition to its linear stiffness, which the model already has*, as a
function of the joint's displacement x [m]. The caller subtracts the force at rest.

``pos(u)`` is max(u, 0) with its corner rounded over the length ``corner`` [m],
(u + sqrt(u^2 + corner^2)) / 2. ``limited(u, a)`` is u kept within -a and a.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ForceLaw:
    """A scalar force law.

    Without memory it is force(x, *coefficients). With memory it depends on the displacement and on
    the displacement and the force one instant earlier, force(x, x_before, force_before, *coefficients).
    It is then exact for any monotone path in between, and of the form limited(force_before + ..., ...). An element that
    never reaches its limit is a spring, whatever the path.

    >>> CLEARANCE.arguments
    ('x', 'k', 'gap', 'corner')
    """

    name: str
    force: str  # expression [N]
    coefficients: tuple[str, ...]
    memory: bool = False
    radial: bool = False  # odd in x: acts along the resultant of y and z
    in_place: bool = False  # takes the place of the joint's linear stiffness

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of all arguments; those by which the force is differentiated come first."""
        return (*self.variables, *self.coefficients)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the arguments by which the force is differentiated."""
        return ("x", "x_before", "force_before") if self.memory else ("x",)


# A spring; a negative stiffness takes away what laws with memory have at rest.
SPRING = ForceLaw("spring", "k*x", ("k",))

CUBIC = ForceLaw("cubic", "k3*x**3", ("k3",), radial=True)

# Dead band: no force within the gap, stiffness k beyond it; the linear k x of the model is subtracted.
CLEARANCE = ForceLaw(
    "clearance", "k*(pos(x - gap) - pos(-x - gap)) - k*x", ("k", "gap", "corner"), radial=True, in_place=True
)

# Two Hertzian contacts pressed against each other by d0; k is their stiffness at x = 0.
HERTZ = ForceLaw(
    "hertz",
    "k/(3*sqrt(d0))*(pos(d0 + x)**Rational(3, 2) - pos(d0 - x)**Rational(3, 2)) - k*x",
    ("k", "d0", "corner"),
    in_place=True,
)

BILINEAR = ForceLaw("bilinear", "k*(ratio - 1)*pos(x)", ("k", "ratio", "corner"))

CONTACT = ForceLaw("contact", "k*(pos(x - gap) - pos(-x - gap))", ("k", "gap", "corner"), radial=True)

# Jenkins element: a spring k and a slider that gives way at the force limit.
JENKINS = ForceLaw("jenkins", "limited(force_before + k*(x - x_before), limit)", ("k", "limit"), memory=True)

LAWS = (SPRING, CUBIC, CLEARANCE, HERTZ, BILINEAR, CONTACT, JENKINS)
