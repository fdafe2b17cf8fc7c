"""The paper's estimator: a small sigmoid network trained by Levenberg-Marquardt.

A network n_in-h-1 has h sigmoid hidden units and one output unit,

    a_j = f(sum_i W_ji x_i + W_j0),   y = g(sum_j v_j a_j + v_0),   f(s) = 1 / (1 + e^-s),

and is trained on the mean squared error of y. The paper trains 11 (3-2-1) to 46 (3-9-1) weights on
10 rows. ``scipy.optimize.least_squares(method="lm")`` refuses fewer residuals than parameters, so
the few lines of the method are written out here, with the rules and defaults of MATLAB's
``trainlm`` (its documentation page): solve (J'J + mu I) dx = -J'e; an improving step is taken and
mu divided by ten, any other is dropped and mu multiplied by ten.

Every array may carry a leading axis of independent problems (n), which are solved side by side.
Weights and normalised quantities have no unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rigtwin.rotor.model.arrays import FloatArray, IntArray

# (parameters (m, p), which problems they belong to (m,)) -> residuals (m, n_rows), Jacobian (m, n_rows, p)
ResidualFunction = Callable[[FloatArray, IntArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Activation:
    """Output of a unit, and its derivative written as a function of that output."""

    value: Callable[[FloatArray], FloatArray]
    slope: Callable[[FloatArray], FloatArray]


LOGISTIC = Activation(value=expit, slope=lambda y: y * (1.0 - y))
LINEAR = Activation(value=lambda s: s, slope=np.ones_like)


@dataclass(frozen=True)
class Network:
    """Architecture n_inputs-n_hidden-1; hidden units are logistic.

    Weights are stored flat: row j of the hidden layer as (W_j1 ... W_jn, W_j0), row after row,
    then (v_1 ... v_h, v_0).
    """

    n_inputs: int
    n_hidden: int
    output: Activation = LOGISTIC
    bias_input: float = 1.0  # what the bias weights multiply; 0 leaves the biases out

    @property
    def n_weights(self) -> int:
        """Number of weights, biases included."""
        return self.n_hidden * (self.n_inputs + 1) + self.n_hidden + 1

    def layers(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Hidden layer (..., n_hidden, n_inputs + 1) and output layer (..., n_hidden + 1)."""
        n = self.n_hidden * (self.n_inputs + 1)
        return weights[..., :n].reshape(*weights.shape[:-1], self.n_hidden, self.n_inputs + 1), weights[..., n:]

    def flat(self, hidden: FloatArray, output: FloatArray) -> FloatArray:
        """(..., n_weights) weights, the inverse of ``layers``."""
        return np.concatenate([hidden.reshape(*hidden.shape[:-2], -1), output], axis=-1)

    def random_weights(self, rng: np.random.Generator, n: int) -> FloatArray:
        """(n, n_weights) starting weights, uniform between -1 and 1."""
        return rng.uniform(-1.0, 1.0, (n, self.n_weights))


def outputs(network: Network, weights: FloatArray, X: FloatArray) -> FloatArray:
    """Output of the network for every row.

    Parameters
    ----------
    network : the architecture
    weights : (..., n_weights) [-]
    X : (..., n_rows, n_inputs) normalised inputs [-]

    Returns
    -------
    (..., n_rows) normalised outputs [-]
    """
    return _forward(network, weights, X)[2]


def outputs_and_jacobian(network: Network, weights: FloatArray, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Outputs and their derivatives by back-propagation.

    dy/dv_j = g' a_j,   dy/dW_ji = g' v_j a_j (1 - a_j) x_i

    Returns
    -------
    (..., n_rows) outputs and (..., n_rows, n_weights) Jacobian, columns in the order of the weights
    """
    x, a, y = _forward(network, weights, X)
    v = network.layers(weights)[1][..., None, :-1]  # (..., 1, n_hidden)
    delta = v * LOGISTIC.slope(a[..., :-1])  # (..., n_rows, n_hidden)
    to_hidden = delta[..., :, None] * x[..., None, :]  # (..., n_rows, n_hidden, n_inputs + 1)
    to_hidden = to_hidden.reshape(*to_hidden.shape[:-2], -1)
    return y, network.output.slope(y)[..., None] * np.concatenate([to_hidden, a], axis=-1)


def _forward(network: Network, weights: FloatArray, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inputs and hidden outputs, each with the bias input appended, and the outputs."""
    W, v = network.layers(weights)
    x = _with_bias(X, network.bias_input)  # (..., n_rows, n_inputs + 1)
    a = _with_bias(LOGISTIC.value(x @ np.swapaxes(W, -1, -2)), network.bias_input)  # (..., n_rows, n_hidden + 1)
    return x, a, network.output.value((a @ v[..., None])[..., 0])


def _with_bias(values: FloatArray, bias_input: float) -> FloatArray:
    return np.concatenate([values, np.full((*values.shape[:-1], 1), bias_input)], axis=-1)


@dataclass(frozen=True)
class LevenbergMarquardt:
    """When to stop and how to damp.

    The damping defaults are ``trainlm``'s. Its default gradient limit went from 1e-10 to 1e-7 over
    the years; the lower one is needed to reach training errors as small as the paper prints.
    """

    max_steps: int = 1000  # steps tried, dropped ones included
    min_gradient: float = 1e-10  # 2-norm of the gradient of the mean squared error
    mu: float = 1e-3
    mu_decrease: float = 0.1
    mu_increase: float = 10.0
    mu_max: float = 1e10
    # A step is never longer than |e| / (2 sqrt(mu)); the floor keeps it, and exp(), finite.
    mu_min: float = 1e-12


TRAINLM = LevenbergMarquardt()


@dataclass(frozen=True)
class Fit:
    """Where Levenberg-Marquardt ended, for each of n problems."""

    parameters: FloatArray  # (n, p)
    mse: FloatArray  # (n,) mean squared residual
    stopped_by: NDArray[np.str_]  # (n,) "gradient", "damping" (no step improves any more) or "max_steps"


def minimise(residuals: ResidualFunction, start: FloatArray, settings: LevenbergMarquardt = TRAINLM) -> Fit:
    """Minimise the mean squared residual of n independent problems.

    Parameters
    ----------
    residuals : residuals and Jacobian of the problems asked for
    start : (n, p) starting parameters
    settings : damping and stopping rules

    Returns
    -------
    Fit, the best point met in each problem
    """
    x, running = start.copy(), np.arange(len(start))
    mu = np.full(len(start), settings.mu)
    e, J = residuals(x, running)  # (n, n_rows), (n, n_rows, p)
    for _ in range(settings.max_steps):
        running = running[_stopped_by(e[running], J[running], mu[running], settings) == "max_steps"]
        if running.size == 0:
            break
        trial = x[running] + marquardt_step(e[running], J[running], mu[running])
        e_trial, J_trial = residuals(trial, running)
        better = _mean_square(e_trial) < _mean_square(e[running])
        taken = running[better]
        x[taken], e[taken], J[taken] = trial[better], e_trial[better], J_trial[better]
        lower = np.maximum(mu[running] * settings.mu_decrease, settings.mu_min)
        mu[running] = np.where(better, lower, mu[running] * settings.mu_increase)
    return Fit(x, _mean_square(e), _stopped_by(e, J, mu, settings))


def marquardt_step(e: FloatArray, J: FloatArray, mu: FloatArray) -> FloatArray:
    """Step dx = -(J'J + mu I)^-1 J'e, computed as -J'(JJ' + mu I)^-1 e.

    The two are equal for mu > 0; the second solves n_rows equations instead of p, the smaller
    system when there are more weights than rows.

    Parameters
    ----------
    e : (n, n_rows) residuals
    J : (n, n_rows, p) Jacobian
    mu : (n,) damping, positive

    Returns
    -------
    (n, p) step
    """
    Jt = np.swapaxes(J, -1, -2)
    damped = J @ Jt + mu[:, None, None] * np.eye(e.shape[-1])  # (n, n_rows, n_rows)
    return -(Jt @ np.linalg.solve(damped, e[..., None]))[..., 0]


def _mean_square(e: FloatArray) -> FloatArray:
    return (e**2).mean(axis=-1)


def _stopped_by(e: FloatArray, J: FloatArray, mu: FloatArray, settings: LevenbergMarquardt) -> NDArray[np.str_]:
    gradient = 2.0 / e.shape[-1] * np.linalg.norm((e[..., None, :] @ J)[..., 0, :], axis=-1)
    damped_out = np.where(mu > settings.mu_max, "damping", "max_steps")
    return np.where(gradient < settings.min_gradient, "gradient", damped_out)


def train(
    network: Network,
    X: FloatArray,
    targets: FloatArray,
    rng: np.random.Generator,
    *,
    settings: LevenbergMarquardt = TRAINLM,
) -> Fit:
    """Train one network per problem from random starting weights.

    Parameters
    ----------
    network : the architecture
    X : (n, n_rows, n_inputs) normalised inputs [-]
    targets : (n, n_rows) normalised outputs wanted [-]
    rng : source of the starting weights
    settings : damping and stopping rules

    Returns
    -------
    Fit with the weights (n, n_weights) as parameters
    """

    def residuals(weights: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        y, J = outputs_and_jacobian(network, weights, X[which])
        return y - targets[which], J

    return minimise(residuals, network.random_weights(rng, len(X)), settings)


@dataclass(frozen=True)
class MinMax:
    """Straight-line normalisation: ``low`` goes to ``to[0]``, ``high`` to ``to[1]``.

    >>> MinMax.of(np.array([10.0, 30.0])).normalise(np.array([10.0, 20.0, 30.0]))
    array([0. , 0.5, 1. ])
    """

    low: FloatArray  # (n_columns,) or (), smallest value, in the unit of the data
    high: FloatArray  # like low, largest value
    to: tuple[float, float] = (0.0, 1.0)

    @classmethod
    def of(cls, values: FloatArray, to: tuple[float, float] = (0.0, 1.0)) -> MinMax:
        """From the smallest and largest value of each column of (n_rows, ...) data.

        Raises ValueError when a column does not vary.
        """
        low, high = np.min(values, axis=0), np.max(values, axis=0)
        if np.any(low >= high):
            raise ValueError("a column holds one value only and cannot be normalised; leave it out")
        return cls(low, high, to)

    def normalise(self, values: FloatArray) -> FloatArray:
        """Normalised values [-]; data outside [low, high] lands outside ``to``."""
        return self.to[0] + (values - self.low) * ((self.to[1] - self.to[0]) / (self.high - self.low))

    def restore(self, normalised: FloatArray) -> FloatArray:
        """Values in the unit of the data."""
        return self.low + (normalised - self.to[0]) * ((self.high - self.low) / (self.to[1] - self.to[0]))
