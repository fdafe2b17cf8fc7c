"""Tolerances by name, each with its reason. Relative unless a unit is given."""

import math

# What float64 leaves after a few hundred operations; always times the scale of the quantity.
ROUND_OFF = 1e-10

# An unsymmetric eigenvalue problem of a beam spans (f_max / f_1)^2, about 1e7 on a coarse mesh;
# that factor times the machine's 1e-16, with room to spare.
EIGENVALUE_ROUND_OFF = 1e-7

# A response summed over eigenvalues: their round-off (1e-16 of the highest, 1e5 rad/s) over the half
# bandwidth of the lowest mode (0.5 rad/s), times the eigenvectors' condition of a few hundred.
SPECTRAL = 1e-8

# The stepper's matrix exponential multiplies round-off by up to h * omega_max, about 1e6 for a
# second of the paper's rotor.
STEPPER = 1e-9

# A mode with damping ratio zeta: frequency and peak height differ from the undamped mode's, and
# other modes add to it, in the order of zeta^2 and zeta; for the 0.1 % used in these tests.
LIGHT_DAMPING = 1e-3

# A shaft made a million times lighter than what it carries stands for a massless one.
NEARLY_MASSLESS = 1e-5

# Timoshenko elements of a thirtieth of a wavelength or less, second order in the element length.
FINE_MESH = 1e-4

# Observed order of convergence against the theoretical one.
CONVERGENCE_ORDER = 0.2

# The paper's six elements against a converged mesh (bar of the project).
SIX_ELEMENTS = 1e-4

# Table 1, program columns: 0.5 % of unknown origin in the paper's program, see docs/reproduction.md.
TABLE_1_PROGRAM = 0.0055

# Table 1, ANSYS columns by the linear element: BEAM188's section integration is not modelled.
TABLE_1_ANSYS = 0.019

# Table 2, shifts: Table 1's difference seen through differences of frequencies.
TABLE_2_SHIFT = 0.035

# Another code, same theory: its mesh (44 nodes), three printed decimals, five digits of inertia.
OTHER_CODE = 1e-4


def hermite_error(half_waves: float, elements: int) -> float:
    """Relative error of a frequency with Hermite cubics, (k h)^4 / 1440, doubled for clamped ends."""
    return 2 * (math.pi * half_waves / elements) ** 4 / 1440
