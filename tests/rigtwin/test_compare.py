"""``rigtwin compare``: what has changed is found, with honest errors, and what has not is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import rigtwin
from rigtwin.api.comparisons import Comparison, holm_limit
from rigtwin.sim.campaign import Campaign, NominalBelief, PeakList, Run
from rigtwin.sim.campaign_folder import save_campaign
from tests.rigtwin.conftest import run, run_json

RIG = "nit-rourkela"
NOISE = 0.01


def measured(k_b: float, seed: int, support: str = "bearing", gain: float = 1.0) -> Run:
    """The model's response with noise of 1 % of each line, refined round the resonances."""
    modes = rigtwin.model_modes(RIG, k_b=k_b, support=support, n_modes=2).frequency_hz  # type: ignore[arg-type]
    lines = np.unique(np.round(np.concatenate([
        np.linspace(50, 400, 71), *(np.round(f, 1) + np.linspace(-2, 2, 161) for f in modes)
    ]), 6))  # fmt: skip
    clean = rigtwin.model_response(RIG, lines, k_b=k_b, support=support)  # type: ignore[arg-type]
    rng = np.random.default_rng(seed)
    std = NOISE * np.abs(clean.H)
    error = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / np.sqrt(2)
    return replace(clean, H=gain * (clean.H + error), std=gain * std, name=f"{support}")


def campaign(k_b: float, seed: int, gain: float = 1.0, **nominal: float) -> Campaign:
    runs = tuple(measured(k_b, seed + n, support, gain) for n, support in enumerate(("rigid", "bearing")))
    return Campaign(f"k_b {k_b:g}", RIG, runs, nominal=NominalBelief(**nominal))  # type: ignore[arg-type]


def test_a_softer_bearing_shows_on_bearings_alone_and_by_as_much_as_the_model_says():
    found = rigtwin.compare(campaign(5e6, 1), campaign(4.9e6, 11))
    changed = {(mode.support, mode.mode) for mode in found.modes if mode.frequency_hz.significant}
    assert changed == {("bearing", 1), ("bearing", 2)}
    before, after = (rigtwin.model_modes(RIG, k_b=k, n_modes=2).frequency_hz for k in (5e6, 4.9e6))
    for mode in found.modes:
        if mode.support == "bearing":
            f = mode.frequency_hz
            assert abs(f.change - (after - before)[mode.mode - 1]) < 4 * f.std
            assert f.std < 0.1 * abs(f.change)
    assert "bearing support, mode" in found.sentence


@pytest.fixture(scope="module")
def unchanged() -> list[Comparison]:
    """Thirty rotors, each measured twice."""
    return [rigtwin.compare(campaign(5e6, seed), campaign(5e6, seed + 100)) for seed in range(0, 60, 2)]


def test_the_same_rotor_measured_again_has_not_changed(unchanged):
    """Twelve numbers in each of thirty comparisons; one comparison in twenty may raise an alarm."""
    alarms = sum(bool(found.significant) for found in unchanged)
    assert alarms <= 5  # of 30 comparisons, with a chance of 0.05 each, more than 5 come once in 300
    assert any("Nothing has changed" in found.sentence for found in unchanged)


def test_errors_are_as_large_as_the_scatter(unchanged):
    """Changes of an unchanged rotor, divided by their standard errors, scatter by one."""
    z = []
    for mode in (mode for found in unchanged for mode in found.modes):
        assert mode.damping_ratio
        z += [mode.frequency_hz.change / mode.frequency_hz.std, mode.damping_ratio.change / mode.damping_ratio.std]
    assert len(z) == 240
    assert 0.85 < np.std(z) < 1.15


def test_what_the_campaigns_state_widens_the_errors():
    plain = rigtwin.compare(campaign(5e6, 1), campaign(4.9e6, 11))
    drifting = rigtwin.compare(campaign(5e6, 1, frequency_drift=0.01), campaign(4.9e6, 11, frequency_drift=0.01))
    assert not any(mode.frequency_hz.significant for mode in drifting.modes)
    f = drifting.modes[0].frequency_hz
    assert_allclose(f.std, np.hypot(plain.modes[0].frequency_hz.std, np.sqrt(2) * 0.01 * f.a), rtol=1e-6)


@pytest.mark.parametrize(
    ("gain", "tolerance", "expected"), [(1.05, 0.02, False), (1.05, 0.001, True), (1.3, 0.02, True)]
)
def test_an_amplitude_has_changed_where_gains_cannot_explain_it(gain, tolerance, expected):
    found = rigtwin.compare(
        campaign(5e6, 1, gain_tolerance=tolerance), campaign(5e6, 11, gain, gain_tolerance=tolerance)
    )
    for mode in found.modes:
        assert mode.amplitude
        assert abs(mode.amplitude.change - (gain - 1)) < 4 * mode.amplitude.std
        assert mode.amplitude.significant == expected


def test_responses_are_compared_on_the_lines_that_both_have():
    a, b = campaign(5e6, 1), campaign(5e6, 11, gain=1.05)
    fewer = replace(b, runs=tuple(r.on_lines(np.arange(len(r.frequency_hz)) % 2 == 0) for r in b.runs))
    found = rigtwin.compare(a, fewer)
    for change, run_a in zip(found.runs, a.runs, strict=True):
        assert change.n_lines == (len(run_a.frequency_hz) + 1) // 2
        assert abs(change.gap - 0.052) < 0.002  # 5 % of gain and 1.4 % of noise
        assert abs(change.floor - np.sqrt(1 + 1.05**2) * NOISE) < 0.001


def test_lists_of_resonances_are_compared_too():
    lists = [
        Campaign("", RIG, peaks=(PeakList("rigid", np.array([100.0, 324.0]) + d, np.array([0.1, 0.1])),))
        for d in (0, 1)
    ]
    found = rigtwin.compare(*lists)
    assert [mode.frequency_hz.change for mode in found.modes] == [1.0, 1.0]
    assert all(mode.frequency_hz.significant for mode in found.modes)


def test_what_has_no_counterpart_is_named_and_nothing_in_common_is_refused():
    a = campaign(5e6, 1)
    found = rigtwin.compare(a, replace(a, runs=a.runs[:1]))
    assert "without a counterpart, and left out: bearing of A" in found.remarks
    with pytest.raises(rigtwin.UserError, match=r"nothing in campaign A .* has a counterpart .*; A has rigid"):
        rigtwin.compare(replace(a, runs=a.runs[:1]), replace(a, runs=a.runs[1:]))


def test_runs_of_forces_that_were_measured_are_of_one_level():
    a, b = campaign(5e6, 1), campaign(5e6, 11)

    def driven(runs, level):
        return tuple(replace(r, force_amplitude_N=level, force_N=np.full(len(r.frequency_hz), level)) for r in runs)

    first = replace(a, runs=driven(a.runs, 1.0234))
    assert len(rigtwin.compare(first, replace(b, runs=driven(b.runs, 1.0235))).pairs) == 2
    with pytest.raises(rigtwin.UserError, match="nothing in campaign A"):
        rigtwin.compare(first, replace(b, runs=driven(b.runs, 1.5)))


def test_magnitudes_are_compared_line_by_line():
    a = campaign(5e6, 1)
    silent = replace(a, runs=tuple(replace(r, H=np.abs(r.H).astype(complex), magnitude_only=True) for r in a.runs))
    found = rigtwin.compare(silent, silent)
    assert found.modes == ()
    assert [r.gap for r in found.runs] == [0.0, 0.0]
    assert any("holds magnitudes only" in words for words in found.remarks)


def test_holm_is_stricter_than_each_test_alone_and_milder_than_dividing_by_all():
    assert holm_limit([0.012, 0.02, 0.04, 0.9]) == 0.012
    assert holm_limit([0.0124, 0.016, 0.024, 0.04]) == 0.04  # dividing by four would keep the first alone
    assert holm_limit([0.03, 0.04]) == -1.0


def test_the_command_prints_and_writes_what_the_function_finds(tmp_path):
    for name, k_b, seed in (("before", 5e6, 1), ("after", 4.9e6, 11)):
        save_campaign(campaign(k_b, seed), tmp_path / name)
    found = rigtwin.compare(tmp_path / "before", tmp_path / "after")
    told = run_json("compare", tmp_path / "before", tmp_path / "after")
    assert told["sentence"] == found.sentence
    assert [m["frequency_hz"]["change"] for m in told["modes"]] == [m.frequency_hz.change for m in found.modes]
    printed = run("compare", tmp_path / "before", tmp_path / "after", "--out", tmp_path / "page.html")
    assert printed.exit_code == 0, printed.output
    assert found.sentence in printed.stdout
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "line by line" in page
    assert page.count('class="figure"') >= 2
    assert "<polyline" in found._repr_html_()
