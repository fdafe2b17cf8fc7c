"""Modes of responses whose truth is known by construction, and errors judged by their null distribution."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.optimize import curve_fit

from rigtwin.sim.campaign import Channel, MeasurementError, Run
from rigtwin.sim.modal_fit import (
    ModalFitError,
    Mode,
    driving_point,
    fit_mode,
    fit_modes,
    half_power_band,
    resonances,
    try_modes,
)

# Exact data inside the fitted model: what the optimiser's stopping rule leaves.
EXACT_FREQUENCY, EXACT_DAMPING = 1e-9, 1e-6

# A statistic with a fixed seed is rejected where its null distribution gives it less than this.
REJECTED = 1e-3

SEEDS = 100
ORDER = {"receptance": 0, "mobility": 1, "accelerance": 2}
EVERY_QUANTITY = pytest.mark.parametrize("quantity", ORDER)


@dataclass(frozen=True)
class Truth:
    """R / (omega_r^2 - omega^2 + 2 i zeta omega_r omega) of the receptance."""

    frequency_hz: float
    damping_ratio: float
    residue: Sequence[complex]  # (n_channels,)

    def receptance(self, frequency_hz: np.ndarray) -> np.ndarray:
        """(n_freq, n_channels)."""
        w, w_r = 2 * np.pi * frequency_hz[:, None], 2 * np.pi * self.frequency_hz
        return np.asarray(self.residue) / (w_r**2 - w**2 + 2j * self.damping_ratio * w_r * w)

    def resonance(self, quantity: str) -> np.ndarray:
        """(n_channels,) size of the mode's own response at omega_r."""
        w_r = 2 * np.pi * self.frequency_hz
        return np.abs(self.residue) / (2 * self.damping_ratio) * w_r ** (ORDER[quantity] - 2)


def two_modes(zeta: float = 1e-3) -> list[Truth]:
    """Like the rotor's: a third as far apart as they are high, residues of either sign."""
    return [Truth(96.0, zeta, [0.1, 0.2, 0.15]), Truth(297.0, zeta, [0.1, -0.05, 0.12])]


def raster(modes: Sequence[Truth], inner: int = 8) -> np.ndarray:
    """Lines of a refined sweep: ``inner`` intervals in each half-power band and eight lines round it."""
    near = np.concatenate([np.linspace(-0.5, 0.5, inner + 1), [-8, -4, -2, -1, 1, 2, 4, 8]])
    lines = [m.frequency_hz * (1 + 2 * m.damping_ratio * near) for m in modes]
    every = np.unique(np.concatenate([np.linspace(20, 400, 96), *lines]))
    return every[every <= 400]


def measured(
    modes: Sequence[Truth], quantity: str = "accelerance", *, rest: complex = 0.0, lines: np.ndarray | None = None
) -> Run:
    """Exact data: the modes and a constant receptance, the sum of all modes far above."""
    f = raster(modes) if lines is None else lines
    factor = (2j * np.pi * f[:, None]) ** ORDER[quantity]
    H = factor * (sum(m.receptance(f) for m in modes) + rest)
    channels = tuple(Channel(node) for node in range(1, H.shape[1] + 1))
    return Run(f, H, channels, "bearing", quantity=quantity, name="run")  # pyright: ignore[reportArgumentType]


def with_errors(run: Run, std: np.ndarray | float, seed: int) -> Run:
    """The run with circular complex noise of this standard error, which it states."""
    rng = np.random.default_rng(seed)
    std = np.broadcast_to(std, run.H.shape).copy()
    errors = rng.standard_normal(run.H.shape) + 1j * rng.standard_normal(run.H.shape)
    return replace(run, H=run.H + std * errors / np.sqrt(2), std=std)


def z_scores(modes: Sequence[Mode], truth: Sequence[Truth], quantity: str = "accelerance") -> np.ndarray:
    """(n_modes, 2 + n_channels) errors in standard errors: frequency, damping ratio, resonances."""
    return np.array(
        [
            [
                (m.frequency_hz - t.frequency_hz) / m.frequency_std_hz,
                (m.damping_ratio - t.damping_ratio) / m.damping_ratio_std,
                *((m.resonance - t.resonance(quantity)) / m.resonance_std),
            ]
            for m, t in zip(modes, truth, strict=True)
        ]
    )


def assert_unit_variance(z: np.ndarray) -> None:
    """Each column's sum of squares over the seeds is chi-squared; a few columns share the rejection."""
    low, high = stats.chi2(len(z)).ppf([REJECTED / 4, 1 - REJECTED / 4])
    squares = (z**2).sum(axis=0)
    assert np.all((low < squares) & (squares < high)), squares / len(z)


def assert_covers_90_per_cent(z: np.ndarray) -> None:
    for covered in np.count_nonzero(np.abs(z) < stats.norm.ppf(0.95), axis=0):
        assert stats.binomtest(int(covered), len(z), 0.9).pvalue > REJECTED / 4


# -- exact data ------------------------------------------------------------------------------------


@EVERY_QUANTITY
@pytest.mark.parametrize("zeta", [1e-4, 1e-3, 2e-2])
def test_a_mode_and_its_residual_are_found_exactly(quantity, zeta):
    truth = Truth(96.0, zeta, [0.1, -0.2j, 0.15 + 0.01j])
    (mode,) = fit_modes(measured([truth], quantity, rest=1e-6))
    assert_allclose(mode.frequency_hz, 96.0, rtol=EXACT_FREQUENCY)
    assert_allclose(mode.damping_ratio, zeta, rtol=EXACT_DAMPING)
    assert_allclose(mode.resonance, truth.resonance(quantity), rtol=EXACT_DAMPING)
    # Divided by omega_r^2 and by the quantity's own factor at omega_r.
    residue = 2 * zeta * truth.resonance(quantity) * np.exp(1j * np.angle(truth.residue))
    assert_allclose(mode.residue, residue, rtol=EXACT_DAMPING)


@EVERY_QUANTITY
@pytest.mark.parametrize("zeta", [5e-4, 1e-3, 2e-3, 5e-3])
def test_neighbours_bias_a_mode_by_what_its_linear_residual_leaves_of_them(quantity, zeta):
    """Curvature of the neighbours' tails over a window of 17 half-power bands: f goes with zeta^4, zeta with zeta^3."""
    truth = [*two_modes(zeta), Truth(700.0, zeta, [-0.1, 0.1, 0.1])]
    found = fit_modes(measured(truth, quantity, rest=1e-7))
    assert len(found) == 2
    for mode, true in zip(found, truth[:2], strict=True):
        assert_allclose(mode.frequency_hz, true.frequency_hz, rtol=2 * EXACT_FREQUENCY * max(zeta / 1e-3, 1) ** 4)
        assert_allclose(mode.damping_ratio, true.damping_ratio, rtol=EXACT_DAMPING * max(zeta / 1e-3, 1) ** 3)
        assert_allclose(mode.resonance, true.resonance(quantity), rtol=EXACT_DAMPING * max(zeta / 1e-3, 1) ** 3)


def test_the_bias_by_a_neighbour_falls_with_the_fourth_power_of_the_damping():
    def bias(zeta: float) -> float:
        return abs(fit_modes(measured(two_modes(zeta)))[1].frequency_hz / 297.0 - 1)

    orders = [np.log(bias(2 * zeta) / bias(zeta)) / np.log(2) for zeta in (1e-3, 2e-3)]
    assert_allclose(orders, 4.0, atol=0.2)


def test_two_per_cent_damping_is_found_to_a_fraction_of_its_band_and_the_misfit_tells():
    """Half-power bands of 12 Hz: the window spans half the raster, and the other mode's tail is not straight."""
    run = with_errors(measured(two_modes(0.02)), 1e-9, seed=0)
    found = fit_modes(run)
    for mode, true in zip(found, two_modes(0.02), strict=True):
        assert abs(mode.frequency_hz - true.frequency_hz) < 0.01 * 2 * 0.02 * true.frequency_hz
        assert_allclose(mode.damping_ratio, 0.02, rtol=0.01)
        assert_allclose(mode.resonance, true.resonance("accelerance"), rtol=0.02)
    assert min(mode.misfit for mode in found) > 100
    # The errors grow with the misfit, so that even then they are of the size of the bias.
    assert np.abs(z_scores(found, two_modes(0.02))).max() < 10


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("bands", [5, 8, 12])
def test_modes_a_few_half_power_bands_apart_are_two_modes(bands, sign):
    """Each is fitted on its own side of the middle; what the other's tail does to it shows in the misfit."""
    zeta = 1e-3
    upper = 100.0 * (1 + 2 * zeta * bands)
    truth = [Truth(100.0, zeta, [0.1, 0.2, 0.15]), Truth(upper, zeta, [sign * 0.1, sign * -0.05, sign * 0.12])]
    exact = fit_modes(measured(truth))
    noisy = fit_modes(with_errors(measured(truth), 0.01 * np.abs(measured(truth).H), seed=1))
    for found in (exact, noisy):
        assert len(found) == 2
        for mode, true in zip(found, truth, strict=True):
            assert abs(mode.frequency_hz - true.frequency_hz) < 0.05 * 2 * zeta * true.frequency_hz
            assert_allclose(mode.damping_ratio, zeta, rtol=0.1)
            assert_allclose(mode.resonance, true.resonance("accelerance"), rtol=0.1)


@EVERY_QUANTITY
def test_the_same_response_has_the_same_modes_in_every_quantity(quantity):
    found = fit_modes(measured(two_modes(), quantity))
    accelerance = fit_modes(measured(two_modes()))
    for mode, other in zip(found, accelerance, strict=True):
        w_r = 2 * np.pi * other.frequency_hz
        assert_allclose(mode.frequency_hz, other.frequency_hz, rtol=1e-8)
        assert_allclose(mode.damping_ratio, other.damping_ratio, rtol=1e-5)
        assert_allclose(mode.resonance, other.resonance * w_r ** (ORDER[quantity] - 2), rtol=1e-5)


@EVERY_QUANTITY
@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e6])
def test_the_unit_of_the_response_does_not_matter(quantity, unit):
    """A stiff machine's receptance is 1e-9 m/N: an optimiser with absolute tolerances would stop at once."""
    found, scaled = (
        fit_modes(measured([replace(t, residue=factor * np.array(t.residue)) for t in two_modes()], quantity))
        for factor in (1.0, unit)
    )
    for mode, other in zip(found, scaled, strict=True):
        assert_allclose(other.frequency_hz, mode.frequency_hz, rtol=EXACT_FREQUENCY)
        assert_allclose(other.damping_ratio, mode.damping_ratio, rtol=EXACT_DAMPING)
        assert_allclose(other.resonance, unit * mode.resonance, rtol=EXACT_DAMPING)


def test_a_channel_that_does_not_move_has_no_part_in_the_mode():
    run = measured([Truth(96.0, 1e-3, [0.0, 0.2, 0.1])])
    (mode,) = fit_modes(run)
    assert (mode.residue[0], mode.resonance[0], mode.resonance_std[0]) == (0, 0, 0)
    assert_allclose(mode.damping_ratio, 1e-3, rtol=EXACT_DAMPING)


def test_the_driving_point_is_the_channel_of_its_node():
    run = measured(two_modes())
    mode = fit_modes(run)[0]
    assert driving_point(run, mode, 2) == (mode.resonance[1], mode.resonance_std[1])
    with pytest.raises(MeasurementError, match="has no channel node2_z"):
        driving_point(run, mode, 2, "z")


# -- noisy data ------------------------------------------------------------------------------------


@EVERY_QUANTITY
def test_errors_are_as_large_as_stated_with_one_per_cent_on_every_line(quantity):
    truth, exact = two_modes(), measured(two_modes(), quantity)
    fits = [fit_modes(with_errors(exact, 0.01 * np.abs(exact.H), seed)) for seed in range(SEEDS)]
    z = np.array([z_scores(fit, truth, quantity) for fit in fits]).reshape(SEEDS, -1)
    assert_unit_variance(z)
    assert_covers_90_per_cent(z)
    assert np.mean([mode.misfit for fit in fits for mode in fit]) == pytest.approx(1.0, abs=0.1)


def test_errors_are_as_large_as_stated_with_the_same_noise_on_every_line():
    exact = measured(two_modes())
    fits = [fit_modes(with_errors(exact, 1e-5 * np.abs(exact.H).max(), seed)) for seed in range(SEEDS)]
    z = np.array([z_scores(fit, two_modes()) for fit in fits]).reshape(SEEDS, -1)
    assert_unit_variance(z)
    assert_covers_90_per_cent(z)


def test_errors_are_as_large_as_stated_where_no_line_lies_on_the_peak():
    """The resonance is then extrapolated, and its error is that of the damping ratio too."""
    truth = Truth(96.0, 1e-3, [0.1, 0.2, 0.15])
    near = 96.0 * (1 + 2e-3 * np.array([-8, -6, -4, -3, -2, -1, 1, 2, 3, 4, 6, 8]))
    exact = measured([truth], lines=np.unique(np.concatenate([np.linspace(20, 400, 96), near])))
    fits = [fit_modes(with_errors(exact, 0.01 * np.abs(exact.H), seed)) for seed in range(SEEDS)]
    z = np.array([z_scores(fit, [truth])[0] for fit in fits])
    assert_unit_variance(z)
    assert_covers_90_per_cent(z)


def test_without_standard_errors_the_scatter_of_the_lines_gives_them():
    """As long as all lines are equally noisy; there is then no misfit to report."""
    exact = measured(two_modes())
    noisy = [with_errors(exact, 1e-5 * np.abs(exact.H).max(), seed) for seed in range(SEEDS)]
    fits = [fit_modes(replace(run, std=None)) for run in noisy]
    z = np.array([z_scores(fit, two_modes()) for fit in fits]).reshape(SEEDS, -1)
    assert_unit_variance(z)
    assert_covers_90_per_cent(z)
    assert all(np.isnan(mode.misfit) for fit in fits for mode in fit)


def test_understated_errors_show_in_the_misfit_and_are_made_good():
    exact = measured(two_modes())
    noisy = [with_errors(exact, 0.01 * np.abs(exact.H), seed) for seed in range(SEEDS)]
    fits = [fit_modes(replace(run, std=run.std / 3)) for run in noisy if run.std is not None]
    z = np.array([z_scores(fit, two_modes()) for fit in fits]).reshape(SEEDS, -1)
    assert np.mean([mode.misfit for fit in fits for mode in fit]) == pytest.approx(9.0, rel=0.1)
    # The misfit has few degrees of freedom of its own: the z-scores follow Student's t, a little wider.
    assert 0.8 < np.mean(z**2) < 1.25


def test_overstated_errors_are_believed():
    """A good fit by luck is no reason to trust an instrument more than its data sheet."""
    exact = measured(two_modes())
    run = with_errors(exact, 0.01 * np.abs(exact.H), seed=0)
    assert run.std is not None
    as_stated, overstated = (fit_modes(replace(run, std=factor * run.std))[0] for factor in (10, 30))
    assert overstated.misfit < as_stated.misfit < 0.05
    assert_allclose(overstated.frequency_std_hz, 3 * as_stated.frequency_std_hz, rtol=1e-3)


def test_an_independent_fit_agrees_and_has_the_same_errors():
    """scipy's curve_fit on the same lines, one channel, real parameters throughout."""
    truth = Truth(96.0, 1e-3, [0.2])
    exact = measured([truth], rest=1e-6, lines=truth.frequency_hz * (1 + 2e-3 * np.linspace(-6, 6, 61)))
    run = with_errors(exact, 0.01 * np.abs(exact.H), seed=5)
    assert run.std is not None
    w, weight = 2 * np.pi * run.frequency_hz, run.std[:, 0] / np.sqrt(2)

    def response(_x, f_r, zeta, a, b, c, d, e, g):
        w_r = 2 * np.pi * f_r
        mode = (a + 1j * b) / (w_r**2 - w**2 + 2j * zeta * w_r * w)
        H = -(w**2) * (mode + 1e-6 * (c + 1j * d + (e + 1j * g) * (w - w_r) / w_r))
        return np.concatenate([H.real, H.imag])

    # Over so narrow a band w - w_r and w^2 - w_r^2 span the same straight lines.
    values = np.concatenate([run.H[:, 0].real, run.H[:, 0].imag])
    start = [96.01, 2e-3, 0.1, 0, 0, 0, 0, 0]
    options = {"sigma": np.tile(weight, 2), "absolute_sigma": True, "method": "trf", "x_scale": "jac"}
    found, covariance = curve_fit(response, np.zeros(0), values, start, **options)
    mode = fit_mode(run, 96.0)
    own_std, other_std = np.array([mode.frequency_std_hz, mode.damping_ratio_std]), np.sqrt(np.diag(covariance))[:2]
    assert np.all(np.abs(np.array([mode.frequency_hz, mode.damping_ratio]) - found[:2]) < 0.02 * own_std)
    # Ours may grow with the misfit.
    assert_allclose(own_std, other_std * np.sqrt(max(mode.misfit, 1.0)), rtol=0.02)


# -- refusals --------------------------------------------------------------------------------------


def test_coarse_lines_are_refused_with_what_would_help():
    run = measured(two_modes(), lines=np.linspace(20, 400, 96))
    with pytest.raises(ModalFitError) as refused:
        fit_modes(run)
    assert re.fullmatch(
        r"run 'run': only \d lines within \S+ Hz of the resonance at \S+ Hz, 8 are needed; "
        r"its half-power band is \S+ Hz wide: refine the lines there",
        str(refused.value),
    )


def test_eight_lines_round_a_resonance_are_enough_and_seven_are_not():
    truth = Truth(96.0, 1e-3, [0.2])
    eight, seven = (
        measured([truth], lines=np.concatenate([[50, 70], 96.0 * (1 + 2e-3 * np.linspace(-1, 1, n)), [150, 200]]))
        for n in (8, 7)
    )
    assert_allclose(fit_modes(eight)[0].frequency_hz, 96.0, rtol=EXACT_FREQUENCY)
    with pytest.raises(ModalFitError, match="only 7 lines"):
        fit_modes(seven)


def test_a_resonance_that_cannot_be_fitted_is_left_out_unless_asked_for(caplog):
    fine = two_modes()[0].frequency_hz * (1 + 1e-3 * np.linspace(-4, 4, 33))
    run = measured(two_modes(), lines=np.union1d(np.linspace(20, 400, 96), fine))
    (mode,) = fit_modes(run)
    assert round(mode.frequency_hz) == 96
    assert re.match(r"a resonance is left out: run 'run': only \d lines within .* at 29\d\.", caplog.messages[-1])
    with pytest.raises(ModalFitError, match=r"only \d lines within"):
        fit_modes(run, 2)


def test_magnitudes_alone_are_refused():
    run = measured(two_modes())
    magnitudes = replace(run, H=np.abs(run.H).astype(complex), magnitude_only=True)
    with pytest.raises(ModalFitError, match="holds magnitudes only; a modal fit needs the phase"):
        fit_modes(magnitudes)


def test_fewer_resonances_than_asked_for_are_an_error_that_counts_them():
    with pytest.raises(ModalFitError, match="shows 2 resonances between 20 and 400 Hz, 3 are needed"):
        fit_modes(measured(two_modes()), 3)


def test_lines_that_were_dropped_take_no_part():
    run = measured(two_modes())
    H = run.H.copy()
    H[[20, 60, 61]] = 0
    whole, holed = fit_modes(run, 2), fit_modes(replace(run, H=H), 2)
    assert_allclose([m.frequency_hz for m in holed], [m.frequency_hz for m in whole], rtol=1e-6)


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_a_flat_response_has_no_mode(level):
    f = np.linspace(20, 400, 96)
    flat = Run(f, np.full((96, 1), level, complex), (Channel(1),), "rigid", quantity="receptance")
    with pytest.raises(ModalFitError, match="shows 0 resonances between 20 and 400 Hz, 1 are needed"):
        fit_modes(flat)


def test_the_lowest_modes_come_first_and_only_as_many_as_asked_for():
    assert [round(mode.frequency_hz) for mode in fit_modes(measured(two_modes()))] == [96, 297]
    assert [round(mode.frequency_hz) for mode in fit_modes(measured(two_modes()), 1)] == [96]


# -- finding resonances ----------------------------------------------------------------------------


def test_resonances_are_the_lines_that_stand_out():
    f = np.arange(1.0, 10.0)
    assert resonances(f, np.array([1, 1, 1.4, 1, 1, 1, 1.6, 1, 1])) == [7.0]
    assert resonances(f, np.ones(9)) == []
    assert resonances(f, np.zeros(9)) == []


@pytest.mark.parametrize("offset", [-0.3, 0.0, 0.4])
def test_the_half_power_band_of_one_mode_is_two_zeta_f(offset):
    """1/|X|^2 of one mode is a parabola but for terms of the order of zeta."""
    zeta = 1e-3
    truth = Truth(96.0, zeta, [1.0])
    f = 96.0 * (1 + 2 * zeta * (np.arange(-2, 3) / 4 + offset / 4))
    centre, width = half_power_band(f, np.abs(truth.receptance(f)[:, 0]), f[2])
    assert_allclose(centre, 96.0, rtol=0, atol=0.01 * 2 * zeta * 96.0)
    assert_allclose(width, 2 * zeta * 96.0, rtol=0.01)


def test_lines_with_no_maximum_between_them_give_the_line_itself_and_their_span():
    f = np.linspace(10, 50, 5)
    assert half_power_band(f, np.array([1.0, 1.0, 0.5, 1.0, 1.0]), 30.0) == (30.0, 40.0)


def test_fitting_leaves_the_run_as_it_was():
    run = measured(two_modes())
    before = run.H.copy()
    fit_modes(run)
    assert_array_equal(run.H, before)


def measured_up_to(end_hz: float) -> Run:
    """Two modes on a band that ends near the second, at 297 Hz."""
    modes = two_modes()
    f = raster(modes)
    f = f[f <= end_hz]
    H = sum(mode.receptance(f) for mode in modes) * -((2 * np.pi * f[:, None]) ** 2)
    return Run(f, np.asarray(H), tuple(Channel(n) for n in (2, 4, 6)), "bearing", name="cut")


@pytest.mark.parametrize(("end_hz", "said"), [(400.0, False), (297.05, True), (297.0, True), (250.0, False)])
def test_a_resonance_at_the_end_of_the_band_is_said_to_be_left_out(end_hz, said):
    modes, left_out = try_modes(measured_up_to(end_hz))
    assert len(modes) == (2 if end_hz == 400 else 1)
    assert any("at the end of the band" in words and "widen the band" in words for words in left_out) == said
