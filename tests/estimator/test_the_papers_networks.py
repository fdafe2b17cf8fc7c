"""The paper's sigmoid networks and their Levenberg-Marquardt training."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import least_squares

from benchmarks.reproduction.paper_networks import (
    LINEAR,
    LOGISTIC,
    LevenbergMarquardt,
    MinMax,
    Network,
    marquardt_step,
    minimise,
    outputs,
    outputs_and_jacobian,
    train,
)

ROUND_OFF = 1e-12
# Central differences with h = 1e-5: truncation h^2 and cancellation eps/h, both about 1e-10.
FINITE_DIFFERENCE = 1e-9
# A gradient of 1e-10 leaves an error of that order where the curvature is of order one.
CONVERGED = 1e-8

PAPER_ARCHITECTURES = (2, 3, 4, 5, 9)


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def central_difference(function, x, h=1e-5):
    """Jacobian of function: (p,) -> (n_rows,), shape (n_rows, p)."""
    return np.stack([(function(x + d) - function(x - d)) / (2 * h) for d in h * np.eye(len(x))], axis=-1)


@pytest.mark.parametrize("output", [LOGISTIC, LINEAR], ids=["logistic", "linear"])
@pytest.mark.parametrize("bias_input", [1.0, 0.0], ids=["biases", "no biases"])
@pytest.mark.parametrize("n_hidden", PAPER_ARCHITECTURES)
def test_jacobian_agrees_with_finite_differences(n_hidden, output, bias_input, rng):
    network = Network(3, n_hidden, output, bias_input)
    weights, X = 3 * network.random_weights(rng, 1)[0], rng.uniform(size=(10, 3))
    _, J = outputs_and_jacobian(network, weights, X)
    expected = central_difference(lambda w: outputs(network, w, X), weights)
    assert_allclose(J, expected, rtol=0, atol=FINITE_DIFFERENCE * np.abs(expected).max())


def test_network_output_is_the_formula_unit_by_unit(rng):
    network = Network(3, 2)
    weights, x = network.random_weights(rng, 1)[0], rng.uniform(size=3)
    W1, W2, v = weights[:4], weights[4:8], weights[8:]
    sigmoid = lambda s: 1 / (1 + np.exp(-s))  # noqa: E731
    a1, a2 = (sigmoid(W[:3] @ x + W[3]) for W in (W1, W2))
    expected = sigmoid(v[0] * a1 + v[1] * a2 + v[2])
    assert_allclose(outputs(network, weights, x[None]), [expected], rtol=ROUND_OFF, atol=0)


def test_the_paper_trains_more_weights_than_it_has_training_rows():
    assert [Network(3, h).n_weights for h in PAPER_ARCHITECTURES] == [11, 16, 21, 26, 46]


def test_permuting_hidden_units_leaves_the_output_and_permutes_the_jacobian(rng):
    network, order = Network(3, 5), rng.permutation(5)
    weights, X = network.random_weights(rng, 1)[0], rng.uniform(size=(10, 3))
    hidden, output = network.layers(weights)
    swapped = network.flat(hidden[order], np.append(output[:-1][order], output[-1]))
    y, J = outputs_and_jacobian(network, weights, X)
    y_swapped, J_swapped = outputs_and_jacobian(network, swapped, X)
    places = network.layers(np.arange(network.n_weights, dtype=float))
    columns = network.flat(places[0][order], np.append(places[1][:-1][order], places[1][-1])).astype(int)
    assert_allclose(y_swapped, y, rtol=ROUND_OFF, atol=0)
    assert_allclose(J_swapped, J[:, columns], rtol=0, atol=ROUND_OFF * np.abs(J).max())


def test_without_biases_the_bias_weights_do_nothing(rng):
    network = Network(3, 4, bias_input=0.0)
    weights, X = network.random_weights(rng, 1)[0], rng.uniform(size=(10, 3))
    hidden, output = network.layers(weights.copy())
    hidden[:, -1], output[-1] = 7.0, -7.0
    assert_array_equal(outputs(network, network.flat(hidden, output), X), outputs(network, weights, X))


@pytest.mark.parametrize(("n_rows", "p"), [(10, 46), (10, 4)], ids=["more weights than rows", "fewer"])
def test_step_solves_the_damped_normal_equations(n_rows, p, rng):
    e, J, mu = rng.normal(size=(1, n_rows)), rng.normal(size=(1, n_rows, p)), np.array([0.01])
    step = marquardt_step(e, J, mu)[0]
    residual = (J[0].T @ J[0] + mu * np.eye(p)) @ step + J[0].T @ e[0]
    assert_allclose(residual, 0.0, rtol=0, atol=1e-10 * np.abs(J[0].T @ e[0]).max())


def test_linear_least_squares_reaches_the_known_optimum(rng):
    A, b = rng.normal(size=(10, 4)), rng.normal(size=10)
    best, squares = np.linalg.lstsq(A, b, rcond=None)[:2]
    fit = minimise(lambda x, _: (x @ A.T - b, np.broadcast_to(A, (len(x), 10, 4)).copy()), np.zeros((1, 4)))
    assert_allclose(fit.parameters[0], best, rtol=CONVERGED, atol=0)
    assert_allclose(fit.mse, squares / 10, rtol=ROUND_OFF, atol=0)
    assert fit.stopped_by.tolist() == ["gradient"]


def test_rosenbrock_valley_is_followed_to_its_minimum():
    def rosenbrock(x, _):
        e = np.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], axis=-1)
        J = np.zeros((len(x), 2, 2))
        J[:, 0, 0], J[:, 0, 1], J[:, 1, 0] = -20 * x[:, 0], 10.0, -1.0
        return e, J

    fit = minimise(rosenbrock, np.array([[-1.2, 1.0], [0.0, 3.0]]))
    assert_allclose(fit.parameters, 1.0, rtol=CONVERGED, atol=0)


def test_small_network_ends_where_scipy_ends(rng):
    network, X = Network(1, 1, LINEAR), np.linspace(0, 1, 12)[:, None]
    targets = X[:, 0] ** 2  # not representable: the optimum has a residual left
    fit = train(network, X[None], targets[None], np.random.default_rng(3), settings=LevenbergMarquardt(max_steps=5000))
    reference = least_squares(
        lambda w: outputs(network, w, X) - targets,
        network.random_weights(np.random.default_rng(3), 1)[0],
        jac=lambda w: outputs_and_jacobian(network, w, X)[1],  # pyright: ignore[reportArgumentType]
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=5000,
    )
    assert_allclose(fit.mse[0], 2 * reference.cost / 12, rtol=1e-6, atol=0)


@pytest.mark.parametrize("n_hidden", [5, 9])
def test_more_weights_than_rows_fit_even_random_targets_exactly(n_hidden, rng):
    X, targets = rng.uniform(size=(6, 10, 3)), rng.uniform(0.1, 0.9, size=(6, 10))
    fit = train(Network(3, n_hidden), X, targets, rng)
    # Random targets hold nothing to learn: a tiny training error says nothing about a network.
    assert np.median(fit.mse) < 1e-18
    assert set(fit.stopped_by) <= {"gradient", "damping", "max_steps"}


def test_network_learns_what_a_network_of_its_size_made(rng):
    network = Network(3, 2)
    truth = 2 * network.random_weights(rng, 1)
    X, X_new = rng.uniform(size=(1, 40, 3)), rng.uniform(size=(1, 40, 3))
    fits = train(network, np.repeat(X, 8, 0), np.repeat(outputs(network, truth, X), 8, 0), rng)
    best = fits.parameters[np.argmin(fits.mse)][None]
    assert_allclose(outputs(network, best, X_new), outputs(network, truth, X_new), rtol=0, atol=1e-6)


def test_same_seed_gives_the_same_weights_and_another_seed_others(rng):
    network, X, targets = Network(3, 4), rng.uniform(size=(3, 10, 3)), rng.uniform(0.1, 0.9, size=(3, 10))
    first, again, other = (train(network, X, targets, np.random.default_rng(s)) for s in (1, 1, 2))
    assert_array_equal(first.parameters, again.parameters)
    assert np.all(first.parameters != other.parameters)


def test_problems_solved_side_by_side_do_not_influence_each_other(rng):
    network, X, targets = Network(3, 3), rng.uniform(size=(4, 10, 3)), rng.uniform(0.1, 0.9, size=(4, 10))
    settings = LevenbergMarquardt(max_steps=20)  # short, before round-off can grow
    together = train(network, X, targets, np.random.default_rng(5), settings=settings)
    start = network.random_weights(np.random.default_rng(5), 4)

    def last_alone(weights, _):
        y, J = outputs_and_jacobian(network, weights, X[3:])
        return y - targets[3:], J

    alone = minimise(last_alone, start[3:], settings)
    assert_allclose(alone.mse, together.mse[3:], rtol=1e-6, atol=0)


def test_training_never_ends_worse_than_it_began(rng):
    network, X, targets = Network(3, 5), rng.uniform(size=(20, 10, 3)), rng.uniform(size=(20, 10))
    start = network.random_weights(np.random.default_rng(6), 20)
    before = ((outputs(network, start, X) - targets) ** 2).mean(axis=-1)
    for max_steps in (0, 1, 3, 30):
        settings = LevenbergMarquardt(max_steps=max_steps)
        after = train(network, X, targets, np.random.default_rng(6), settings=settings).mse
        assert np.all(after <= before)
        before = after


def test_a_problem_nothing_can_improve_stops_by_damping():
    def contradictory(x, _):  # gradient claims a descent that is not there
        return np.ones((len(x), 2)), np.ones((len(x), 2, 3))

    assert minimise(contradictory, np.zeros((1, 3))).stopped_by.tolist() == ["damping"]


def test_normalisation_maps_the_range_and_returns(rng):
    values = rng.normal(size=(12, 3)) * [1.0, 100.0, 1e8]
    scale = MinMax.of(values, to=(0.1, 0.9))
    normalised = scale.normalise(values)
    assert_allclose(normalised.min(axis=0), 0.1, rtol=ROUND_OFF)
    assert_allclose(normalised.max(axis=0), 0.9, rtol=ROUND_OFF)
    assert_allclose(scale.restore(normalised), values, rtol=0, atol=ROUND_OFF * 1e8)


def test_a_constant_column_is_refused():
    with pytest.raises(ValueError, match="one value only"):
        MinMax.of(np.ones((12, 3)))
