"""What is left of a rotor's transients where every line is read a fixed time after its frequency was set."""

from __future__ import annotations

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray


@np.errstate(over="ignore", invalid="ignore")  # a trial may have an unstable pole: it is infinitely far from the data
def transients(omega: FloatArray, poles: ComplexArray | complex, dwell: FloatArray | float) -> ComplexArray:
    """(n_freq, ...) transient of each pole when the reading of a line begins, in the force's own phase.

    A unit force whose phase theta goes on from line to line drives x' = lambda x + e^{i theta} from rest. In the frame
    that turns with the force, x goes from c to s + (c - s) e^{(lambda - i omega) t}, s = 1 / (i omega - lambda); a line
    takes the dwell and the one period over which it is read.

    Parameters
    ----------
    omega : (n_freq, ...) lines in the order of the sweep [rad/s]
    poles : (...) [1/s]
    dwell : (...) time from a line's setting to its reading [s]
    """
    own = poles - 1j * omega
    steady = -1 / own
    fade = np.exp(poles * dwell) * np.exp(-1j * omega * dwell)  # of the dwell; few numbers each
    decay = fade * np.exp(own * 2 * np.pi / omega)
    ends = _affine(decay, steady * (1 - decay))
    begins = np.concatenate([np.zeros_like(ends[:1]), ends[:-1]])
    return (begins - steady) * fade


def as_read(left: ComplexArray, omega: FloatArray, poles: ComplexArray | complex) -> ComplexArray:
    """What synchronous detection over one period makes of transients, as a part of 1 / (i omega - lambda).

    It takes the mean of e^{(lambda - i omega) t}; accelerometers read lambda^2 of a transient, -omega^2 of the rest.
    """
    own = (poles - 1j * omega) * 2 * np.pi / omega
    return left * (np.expm1(own) / own * (poles / (1j * omega)) ** 2)


def _affine(a: ComplexArray, b: ComplexArray, large: int = 1000) -> ComplexArray:
    """(n, ...) x_k = a_k x_(k-1) + b_k from x_(-1) = 0; where steps are small, maps of 1, 2, 4, ... are composed.

    large : numbers in a step from which one step after the other is faster
    """
    if a[0].size > large:
        x = b.copy()
        for k in range(1, len(a)):
            x[k] += a[k] * x[k - 1]
        return x
    a, b, reach = a.copy(), b.copy(), 1
    while reach < len(a):
        b[reach:] = a[reach:] * b[:-reach] + b[reach:]
        a[reach:] = a[reach:] * a[:-reach]
        reach *= 2
    return b
