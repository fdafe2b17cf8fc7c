"""Which candidates are formed from what was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.inference.hypotheses import NOMINAL, Hypothesis, candidates
from rigtwin.gap.search.strategies.dwell import STRONG, WEAK, SweepScale
from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import STRUCTURE, blank

F_HZ = np.linspace(20.0, 400.0, 5)
RIGID, BEARING = blank("rigid", F_HZ), blank("bearing", F_HZ)


def ids(*runs, **options):
    return {h.ids[0] for h in candidates(runs, STRUCTURE, **options)}


def nodes(runs, name):
    return [h.terms[0].fixed[0][1] for h in candidates(runs, STRUCTURE) if h.ids == (name,)]


def test_an_excluded_effect_is_no_candidate():
    left = ids(RIGID, BEARING, exclude=("attached_mass", "open_crack"))
    assert ids(RIGID, BEARING) - left == {"attached_mass", "open_crack"}


def test_linear_and_nonlinear_effects_are_apart():
    linear, nonlinear = ids(RIGID, BEARING), ids(RIGID, BEARING, nonlinear=True)
    assert nonlinear
    assert {EFFECTS[name].family for name in nonlinear} == {"nonlinear"}
    assert {EFFECTS[name].family for name in linear} == {"structure", "support", "chain"}


def test_an_effect_needs_its_support():
    bearings = {name for name, effect in EFFECTS.items() if effect.location == "bearings"}
    assert bearings
    assert not ids(RIGID) & bearings
    assert not ids(RIGID, nonlinear=True) & bearings
    assert "compliant_rigid_support" in ids(RIGID)
    assert "compliant_rigid_support" not in ids(BEARING)
    assert "bearing_damping" in ids(BEARING)


def test_an_effect_of_the_chain_needs_its_quantity():
    assert "force_dropout" not in ids(BEARING)
    assert "force_dropout" in ids(replace(BEARING, quantity="acceleration"))
    assert "sensor_delay" in ids(BEARING)
    assert "sensor_delay" not in ids(replace(BEARING, magnitude_only=True))


def test_sensors_are_where_sensors_are():
    two = blank("bearing", F_HZ, channels=(Channel(2), Channel(6)))
    assert nodes([two], "sensor_position") == [0, 2, 6]
    assert nodes([two], "sensor_gain") == [2, 6]  # of all sensors together: the exciter's gain, a nuisance
    one = blank("bearing", F_HZ, channels=(Channel(3),))
    assert nodes([one], "sensor_mass") == [3]


def test_the_side_of_an_angle_shows_across_the_force_only():
    across = replace(BEARING, channels=(Channel(2), Channel(2, "z")), H=np.zeros((len(BEARING.frequency_hz), 2)))
    for run, low in ((BEARING, 0.0), (across, -np.pi / 2)):
        (found,) = (h for h in candidates([run], STRUCTURE) if h.ids == ("plane_anisotropy",))
        assert found.free[1].low == pytest.approx(low, abs=1e-4)
        sides = {np.sign(start[1]) for start in found.starts()}
        assert sides == ({1.0} if low == 0.0 else {-1.0, 1.0})


def test_a_mass_sits_where_the_rotor_moves():
    assert nodes([RIGID, BEARING], "attached_mass") == [1, 2, 3, 4, 5, 6, 7]
    assert nodes([RIGID], "attached_mass") == [2, 3, 4, 5, 6]


def test_effects_are_equally_probable_and_places_share():
    every = candidates([RIGID, BEARING], STRUCTURE)
    total: dict[str, float] = {}
    for h in every:
        total[h.ids[0]] = total.get(h.ids[0], 0.0) + h.prior
    assert_allclose(list(total.values()), 1 / len(total))


@pytest.mark.parametrize("nonlinear", [False, True])
def test_ranges_reach_to_where_an_effect_does_nothing(nonlinear):
    for h in candidates([RIGID, BEARING, replace(BEARING, quantity="acceleration")], STRUCTURE, nonlinear=nonlinear):
        roles = h.terms[0].effect.parameters()
        for free in h.free:
            if free.name not in roles:
                continue
            role = roles[free.name]
            low, high = scale_of(STRUCTURE).ends(role)
            assert free.low <= low or (free.name, free.low) == ("angle", 0.0)  # only its size shows
            assert free.high >= high
            if isinstance(role.null, (int, float)) and np.isfinite(role.null):
                # In a logarithm nothing is out of reach; it is come near to.
                assert free.low <= role.null <= free.high or (free.log and free.low <= low / 10)
            elif role.null is not None and not isinstance(role.null, str):
                assert free.high >= 10 * high


def test_starts_are_effects_inside_their_ranges():
    for h in candidates([RIGID, BEARING], STRUCTURE):
        for u in h.starts():
            assert len(h.effects(u)) == 1
            for free, x in zip(h.free, u, strict=True):
                assert free.ends[0] <= x <= free.ends[1]


def test_the_nominal_model_is_no_effect():
    assert str(NOMINAL) == "nominal"
    assert NOMINAL.effects(()) == ()
    assert len(NOMINAL.starts()) == 1


def test_a_bent_law_is_straightened_where_it_stands():
    seat, mass = (
        next(h for h in candidates((RIGID, BEARING), STRUCTURE) if h.ids == (name,))
        for name in ("pedestal_flexibility", "attached_mass")
    )
    pair = Hypothesis((*seat.bent.terms, *mass.terms))
    u = np.arange(float(len(pair.coordinates)))
    plain, kept = pair.straightened(u)
    assert plain == Hypothesis((*seat.terms, *mass.terms))
    assert plain.places == pair.places != seat.places
    assert_allclose(kept, [*u[: 1 + len(seat.free)], u[-1]])
    assert plain.straightened(kept)[0] == plain


# -- any rig -------------------------------------------------------------------------------------------


def hung(stiffness: float):
    """The paper's rotor on springs of a stiffness of their own beside one bearing."""
    rig = load_rig("nit-rourkela")
    spring, bearing = rig.support[0].model_copy(update={"stiffness": stiffness}), rig.support[1]
    return assemble(rig.model_copy(update={"support": [spring, bearing]}))


def test_a_rotor_that_swings_on_soft_springs_has_the_time_scale_of_its_bending():
    stiff, soft = scale_of(hung(1e9)), scale_of(hung(50.0))
    assert 0.3 < soft.time / stiff.time < 1  # with a free end it bends faster; it swings some 40 times as slowly


@pytest.mark.parametrize("force", [0.1, 3e3])
@pytest.mark.parametrize("nonlinear", [False, True])
def test_no_range_ends_beyond_what_is_possible(force, nonlinear):
    runs = [blank(support, F_HZ, force_amplitude_N=force) for support in ("rigid", "bearing")]
    found = candidates(runs, hung(50.0), nonlinear=nonlinear)
    assert found
    for hypothesis in found:
        effect = hypothesis.terms[0].effect
        for free in hypothesis.bent.free:
            if free.name in effect.parameters():
                role = effect.parameters()[free.name]
                assert (role.minimum is None) or free.low >= role.minimum, hypothesis
                assert (role.maximum is None) or free.high <= role.maximum, hypothesis
        hypothesis.effects(hypothesis.ends[1:, 1])  # raises where it is not possible


@pytest.mark.parametrize("rig", ["nit-rourkela", "pump-overhung", "spindle"])
def test_dwells_that_are_tried_lie_in_the_range_of_the_rig(rig):
    (sweep,) = (h for h in candidates([RIGID], assemble(load_rig(rig))) if h.ids == ("fast_sweep",))
    (dwell,) = sweep.free
    scale = SweepScale.of(sweep)
    for grid in (WEAK.grid(scale), STRONG.grid(scale)):
        assert (np.diff(grid) > 0).all()
        assert grid[0] == pytest.approx(dwell.low)
        assert grid[-1] <= dwell.high
        assert len(grid) > 300
