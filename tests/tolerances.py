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

# A peak read off speeds a tenth of a half bandwidth apart: (1/20)^2 / 2.
PEAK_BETWEEN_SPEEDS = 2e-3

# A shaft made a million times lighter than what it carries stands for a massless one.
NEARLY_MASSLESS = 1e-5

# Timoshenko elements of a thirtieth of a wavelength or less, second order in the element length.
FINE_MESH = 1e-4

# The nonlinear stepper, after a few periods: 3e-5 of a joint force at every corner it passes, times what
# a bouncing shaft makes of a difference from impact to impact.
NONLINEAR_STEPPER = 1e-3

# What the nonlinear stepper makes of the energy per period, at a few corners in each: a damping ratio of 1e-5.
ENERGY_PER_PERIOD = 1e-4

# Turning points read off a sampled swing of 400 samples a period: (2 pi / 400)^2 / 8.
SLIDING = 5e-5

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

# A force law is a dozen operations on terms that may cancel; times the size of those terms.
LAW_ROUND_OFF = 1e-13

# Central differences with steps of 1e-7: round-off over the step.
DIFFERENCE_QUOTIENT = 1e-6

# A tilt spring of 1e9 N m/rad stands for a clamp: E I / L of the paper's shaft is 4e-6 of it.
NEARLY_CLAMPED = 1e-5

# An effect whose zero is a limit is put there by a million times the end of its prior: what it
# stands in series with is softer by a millionth, times 1/(2 zeta) close to a resonance.
EFFECT_LIMIT = 1e-5

# Two codes with the same matrices on 48 elements: (f_max / f_1)^2 times the machine's 1e-16 is 2e-9.
SAME_MATRICES = 1e-8

# The same in the response of a mode with a damping ratio of 3e-8, at a line 4e-6 of its frequency off:
# round-off of the frequency, 1e-12, over that distance.
SHARP_RESONANCE = 1e-6

# ROSS' steady rub, extrapolated from three time steps: right to 3e-6, third harmonics to 5e-5; all
# relative to the node or to 1e-4 of the largest fundamental, where what has not settled yet shows.
ROSS_RUB = 1e-5
ROSS_RUB_THIRD = 2e-4

# Harmonic balance of a rub with 2048 samples a period: what rounding the contact's corner costs.
ROUNDED_RUB = 1e-4
ROUNDED_RUB_THIRD = 1e-3


def hermite_error(half_waves: float, elements: int) -> float:
    """Relative error of a frequency with Hermite cubics, (k h)^4 / 1440, doubled for clamped ends."""
    return 2 * (math.pi * half_waves / elements) ** 4 / 1440


# Settled lines may hold a transient of 1e-5 (the plan's tolerance); the bar of the project is 1e-4.
SETTLED_LINE = 1e-5

# Two sweeps over the same settled lines: the FMU's clock ticks every 2^-36 s, 4e-8 of a phase at
# 400 Hz, and as much again where a line is a small difference of its modes.
SAME_LINE = 1e-7

# Harmonic balance with seven harmonics or more against closed forms that neglect damping, and against
# direct integration (bars of the project).
HARMONIC_BALANCE = 0.005
HARMONIC_BALANCE_THIRD = 0.02

# Corners rounded by a millionth of the gap, amplitudes of a thousandth of it.
NEARLY_LINEAR = 1e-5

# Energy of a resonance, a small difference of what is stored; eigenvectors' round-off over the damping.
ENERGY = 1e-6

# A corner is rounded by the joint's rate, which differs between way and way back: work of second order in the
# interval, for 512 samples some 1e-6 of what is stored, times some hundred of stored over fed energy.
SAMPLED_CORNERS = 1e-3

# A stator that is touched in passing, by 512 samples of a period; a twentieth of the noise of a good test.
TOUCHED = 5e-4

# A fold, where the frequency changes with the square of the arc length: 1e-4 of a step in slope, squared,
# beside what the curve's start contributes.
FOLD = 1e-6

# A jump in a stepped sweep against the fold (bar of the project) [Hz].
JUMP_HZ = 0.1

# Floquet multipliers by kicks at 256 samples: (2 pi / 256)^2 / 24 of the local stiffness' part in the phase.
KICKS = 1e-3

# The multiplier at a fold, which is one: the root of KICKS, as two multipliers meet near there at light damping.
MULTIPLIER_AT_FOLD = 0.02
