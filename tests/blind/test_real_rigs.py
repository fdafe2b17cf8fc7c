"""Set W9: rotors of three sizes, and effects that are measured against what a workshop does not know."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.blind.generate import real_rigs
from rigtwin.blind.generate.campaigns import Order, make
from rigtwin.blind.generate.case import Case, Tolerances, measure, plan_lines
from rigtwin.blind.generate.draw import Draw, empty_case
from rigtwin.blind.generate.effects import CHAIN, KINDS, LINEAR, STRANGERS, Effect, draw_effect, ranges_of
from rigtwin.blind.generate.lines import resonances
from rigtwin.blind.generate.machine import Setting, Workshop, build_machine
from rigtwin.blind.generate.nonlinear import telling_levels
from rigtwin.blind.generate.real_rigs import (
    KINDS_OF_CAMPAIGN,
    ROTORS,
    WORKSHOP,
    draw_real,
    kind_of,
    replaced,
    rotor_of,
    workshop_case,
)
from rigtwin.blind.generate.response import N_DRIFTING, reported
from rigtwin.blind.generate.rig import REFERENCE, Rig, read_rig
from rigtwin.blind.generate.scale import UNITS, Scale
from rigtwin.blind.generate.sizes import shown_size, size_ratio
from rigtwin.blind.generate.wide import WideDistance, distance_for
from rigtwin.rotor.effects import AttachedMass
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign import NominalBelief
from rigtwin.sim.campaign_folder import load_campaign

OTHERS = tuple(name for name in ROTORS if name != REFERENCE)
SEEN = ("attached_mass", "open_crack", "pedestal_flexibility", "bearing_tilt_stiffness", "disk_inertia")


def usual_setting(rig: Rig, rigid: bool) -> Setting:
    scale = rig.scale
    return Setting(rigid, 1.3e6 * scale.of("N/m"), 20.0 * scale.of("N s/m"), 0.002, rig.drive_node)


def settings_and_lines(rig: Rig, case: Case, rng: np.random.Generator):
    settings = [case.setting(rigid, rig.drive_node) for rigid in (True, False)]
    return settings, [plan_lines(rig, case, s, 1.0, rng, effects=()) for s in settings]


# -- scales -----------------------------------------------------------------------------------------------


def test_the_reference_is_one_exactly_so_that_the_other_sets_stay():
    rig = read_rig(REFERENCE)
    assert rig.scale == Scale(1.0, 1.0, 1.0)
    assert all(rig.scale.of(unit) == 1.0 for unit in UNITS)
    assert all(ranges_of(name, rig) == kind.ranges for name, kind in KINDS.items())
    assert (rig.drive_node, rig.plan.held_out_node, rig.plan.band_hz) == (2, 4, (20.0, 400.0))


def test_a_spring_and_a_mass_of_one_rig_resonate_in_another_at_its_own_frequencies():
    scale = read_rig("spindle").scale
    assert_allclose(np.sqrt(scale.of("N/m") / scale.of("kg")), scale.of("Hz"), rtol=1e-12)
    assert_allclose(scale.of("N s/m") / np.sqrt(scale.of("N/m") * scale.of("kg")), 1.0, rtol=1e-12)
    assert_allclose(scale.of("N/m3") * scale.of("m") ** 2, scale.of("N/m"), rtol=1e-12)


@pytest.mark.parametrize("name", ROTORS)
def test_a_plan_fits_its_rotor(name):
    """The scale of time is the first resonance on rigid supports; the band holds two of them, and more on bearings."""
    rig = read_rig(name)
    rigid, bearing = (build_machine(rig, usual_setting(rig, rigid)) for rigid in (True, False))
    assert_allclose(rigid.omega[0] / 2 / np.pi, rig.plan.first_hz, rtol=0.02)
    assert len(resonances(rigid)) == 2
    assert 2 <= len(resonances(bearing)) <= 4
    assert not {rig.drive_node, rig.plan.held_out_node} & set(rig.bearings)
    assert rig.drive_node != rig.plan.held_out_node


def test_a_rig_with_parts_that_are_not_modelled_is_refused():
    with pytest.raises(ValueError, match="cantilever: a segment with area_m2"):
        read_rig("cantilever")


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("hidden", ["", *SEEN])
def test_both_codes_agree_on_rotors_of_other_sizes(name, rigid, hidden):
    """With accelerometers that stay mounted; the bar is the mesh of the rotor's model."""
    rig, rng = read_rig(name), np.random.default_rng(3)
    setting, mass = usual_setting(rig, rigid), 0.005 * rig.scale.of("kg")
    nodes = tuple(range(1, len(rig.nodes) + 1))
    effects = (draw_effect(rng, hidden, rig),) if hidden else ()
    workshop = Workshop(0.0, 0.0, (0.0,) * len(rig.disks), mass, nodes)
    peaks = resonances(build_machine(rig, setting, effects, workshop))
    lines = np.sort([f * (1 + k * width / f) for f, width in peaks for k in (-3, -0.5, 0, 0.5, 3)])
    sensors = [AttachedMass(mass=mass, node=node) for node in nodes]
    theirs = [
        EFFECTS[e.id](
            **e.parameters, **({} if e.node is None else {"node": e.node}), **({} if e.x is None else {"position": e.x})
        )
        for e in effects
    ]
    condition = Condition(
        k_b=setting.k_b,
        rigid_support=rigid,
        bearing_damping=setting.c_b,
        shaft_damping_ratio=setting.zeta,
        excitation_node=setting.drive_node,
    )
    structure = assemble(load_rig(name), elements_between_nodes=16)
    expected = measured_response(structure, condition, [*theirs, *sensors], lines)
    peak = np.abs(expected).max(axis=0)
    moving = peak > 1e-4 * peak.max()
    error = np.abs(reported(rig, setting, effects, lines, workshop) - expected).max(axis=0)
    assert (error[moving] / peak[moving]).max() < 2e-3


@pytest.mark.parametrize("name", OTHERS)
def test_a_nonlinear_law_is_felt_at_levels_of_the_rotors_own_scale(name):
    """Levels between what its scale of force makes of the reference's weakest and strongest ones."""
    rig, rng = read_rig(name), np.random.default_rng(0)
    effect = draw_effect(rng, "bearing_hertz", rig)
    levels = telling_levels(rig, usual_setting(rig, False), effect, rng)
    assert 1e-2 < levels[1] / rig.scale.of("N") < 1e2


# -- what is drawn ----------------------------------------------------------------------------------------


def test_a_third_hides_nothing_and_an_eighth_a_stranger_and_every_kind_meets_every_rotor():
    cycle = len(KINDS_OF_CAMPAIGN)
    counts = Counter(kind_of(i) for i in range(cycle))
    assert (counts["nothing"], counts["stranger"]) == (cycle // 3, cycle // 8)
    met = {(kind_of(i), rotor_of(i)) for i in range(3 * cycle)}
    assert met == {(kind, rotor) for kind in counts for rotor in ROTORS}


def test_rigs_scatter_as_much_as_a_workshop_does_not_know():
    rng, rig = np.random.default_rng(0), read_rig("pump-overhung")
    cases = [workshop_case(rig, rng) for _ in range(600)]
    believed = [replaced(c, ("shaft_damping", "bearing_damping"), rig) for c in cases]
    deviations = {
        WORKSHOP.modulus: [c.workshop.modulus for c in cases],
        WORKSHOP.span: [c.workshop.span for c in cases],
        WORKSHOP.disk_mass: [c.workshop.disk_masses[1] for c in cases],
        WORKSHOP.shaft_damping: [np.log(c.zeta / b.zeta) for c, b in zip(cases, believed, strict=True)],
        WORKSHOP.bearing_damping: [np.log(c.c_b / b.c_b) for c, b in zip(cases, believed, strict=True)],
    }
    for std, drawn in deviations.items():
        assert_allclose(np.std(drawn), std, rtol=0.1)
        assert abs(np.mean(drawn)) < 0.15 * std
    drifts = np.array([c.tolerances.drift for c in cases])
    assert 1e-4 <= drifts.min() < 2e-4
    assert_allclose(np.mean(drifts == 3e-3), 0.5, atol=0.06)
    assert drifts.max() == 3e-3


def test_half_of_the_campaigns_state_their_dampings_and_a_rig_without_any_always_does():
    rng = np.random.default_rng(1)
    stating = {}
    for name in ROTORS:
        cases = [workshop_case(read_rig(name), rng) for _ in range(300)]
        stating[name] = np.mean(["shaft_damping_ratio" in (c.stated or {}) for c in cases])
        for case in cases:
            told = case.stated or {}
            assert ("shaft_damping_ratio" in told) == ("bearing_damping_tolerance" in told)
            assert told.get("shaft_damping_tolerance", WORKSHOP.shaft_damping) == WORKSHOP.shaft_damping
            assert told.get("frequency_drift", case.tolerances.drift) == case.tolerances.drift
            assert told["sensor_mass_kg"] == case.workshop.sensor_mass > 0
    assert stating[REFERENCE] == 1.0
    assert_allclose(np.mean(list(stating.values())), 0.5, atol=0.05)


def test_tolerances_that_are_not_stated_are_those_that_are_taken_anyway():
    usual = NominalBelief()
    assert (WORKSHOP.modulus, WORKSHOP.span) == (usual.modulus_tolerance, usual.span_tolerance)
    assert (WORKSHOP.disk_mass, WORKSHOP.gain) == (usual.disk_mass_tolerance, usual.gain_tolerance)


@pytest.mark.long
@pytest.mark.parametrize(("index", "groups"), [(15, 2), (5, 3)])
def test_several_effects_are_of_different_groups(index, groups):
    rig = read_rig(rotor_of(index))
    draw = draw_real(rig, index, np.random.default_rng(2))
    assert len({KINDS[e.id].group for e in draw.case.effects}) == groups == len(draw.case.effects)
    assert min(draw.ratios) >= 3


def test_a_stranger_is_in_no_library():
    draw = draw_real(read_rig(rotor_of(6)), 6, np.random.default_rng(2))
    assert {e.id for e in draw.case.effects} <= set(STRANGERS)


# -- runs -------------------------------------------------------------------------------------------------


def test_a_repeat_is_a_run_of_its_own_with_its_own_drift_and_gains():
    rig, rng = read_rig("spindle"), np.random.default_rng(4)
    case = replace(workshop_case(rig, rng), repeats=1)
    case = replace(case, tolerances=replace(case.tolerances, repeatability=0.01, drift=0.0, gain=0.0))
    first, again = measure(rig, case, rig.drive_node, [*case.levels, *case.levels], rng)[1:]
    assert (first.name, again.name) == ("run02_bearing_0.9N", "run03_bearing_0.9N")
    own = [np.abs(run.actual / run.ideal).mean(axis=0) / (1 + np.array(case.sensor_gains)) for run in (first, again)]
    assert 1e-3 < np.std(own[0] - own[1]) < 0.05


def test_a_campaign_says_what_its_workshop_states_and_no_more(tmp_path):
    order = Order("W9", "tuning", 1, 0)
    label = make(order, tmp_path)
    campaign = load_campaign(tmp_path / order.name / "measured")
    assert (label["rotor"], campaign.rig, label["n_effects"]) == (REFERENCE, REFERENCE, 0)
    assert [run.support for run in campaign.runs][:2] == ["rigid", "bearing"]
    assert label["stated"]["sensor_mass_kg"] == campaign.nominal.sensor_mass_kg
    assert campaign.nominal.shaft_damping_tolerance == WORKSHOP.shaft_damping
    assert label["shaft_damping_ratio"] != campaign.nominal.shaft_damping_ratio
    text = (tmp_path / order.name / "measured" / "campaign.toml").read_text(encoding="utf-8")
    assert "W9" not in text
    assert len({run.excitation_node for run in load_campaign(tmp_path / order.name / "held_out").runs}) == 1


# -- sizes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [REFERENCE, *(pytest.param(n, marks=pytest.mark.long) for n in OTHERS)])
def test_what_a_workshop_does_not_know_costs_no_more_than_its_prior(name):
    """A rig one standard deviation off in everything, resonances drifted by more than their width."""
    rig, rng = read_rig(name), np.random.default_rng(2)
    case = workshop_case(rig, rng)
    case = replace(case, tolerances=replace(case.tolerances, drift=3e-3))
    settings, lines = settings_and_lines(rig, case, rng)
    known, workshop = case.tolerances, case.workshop
    other = replace(
        workshop,
        modulus=workshop.modulus - known.modulus,
        span=workshop.span + known.span,
        disk_masses=tuple(m + known.disk_mass for m in workshop.disk_masses),
    )
    factors = {"zeta": np.exp(known.shaft_damping), "c_b": np.exp(-known.bearing_damping), "k_b": 1.3}
    signs = [rng.choice([-1.0, 1.0], N_DRIFTING) for _ in settings]
    signs = [np.where(np.arange(N_DRIFTING) < 6, sign, 0.0) for sign in signs]
    responses = [
        1.02
        * reported(
            rig,
            replace(s, **{key: factor * getattr(s, key) for key, factor in factors.items()}),
            (),
            f,
            other,
            known.drift * np.vstack([sign, sign]),
        )
        for s, f, sign in zip(settings, lines, signs, strict=True)
    ]
    cost = np.sqrt(4 + len(rig.disks) + 6 * len(settings) + len(settings))
    assert distance_for(rig, case, settings, lines).of(responses) < 1.1 * cost
    assert distance_for(rig, case, settings, lines).of([1.3 * H for H in responses]) > 1.3 * cost


def test_a_longer_span_is_followed_exactly():
    """Ten times closer than without shapes whose cross-sections turn less."""
    rig = read_rig(REFERENCE)
    case = replace(empty_case(rig, "W3", np.random.default_rng(0)), workshop=Workshop(), tolerances=WORKSHOP)
    settings, lines = settings_and_lines(rig, case, np.random.default_rng(1))
    longer = [reported(rig, s, (), f, Workshop(span=1e-3)) for s, f in zip(settings, lines, strict=True)]
    wide = distance_for(rig, case, settings, lines)
    assert isinstance(wide, WideDistance)
    known = np.eye(wide.n_physical)[1] * 1e-3
    modelled = [wide._model(i, known)[0] for i in range(2)]
    stiff = distance_for(rig, replace(case, tolerances=Tolerances()), settings, lines)
    before = [run.at(known[: stiff.n_physical]) for run in stiff.runs]
    for H, new, old in zip(longer, modelled, before, strict=True):
        assert np.abs(new - H).max() < 0.1 * np.abs(old - H).max()


def test_a_damping_within_its_tolerance_is_no_effect_that_could_be_seen():
    rig, rng = read_rig(REFERENCE), np.random.default_rng(5)
    case = replace(empty_case(rig, "W9", rng), noise=0.008, tolerances=WORKSHOP)
    known = replace(case, tolerances=Tolerances())
    effect = Effect("shaft_damping", {"damping_ratio": 1.5 * case.zeta})
    assert size_ratio(rig, case, effect, np.random.default_rng(1)) < 1
    assert size_ratio(rig, known, effect, np.random.default_rng(1)) > 3


@pytest.mark.parametrize("name", [OTHERS[0], *(pytest.param(n, marks=pytest.mark.long) for n in OTHERS[1:])])
def test_a_mass_is_the_larger_the_heavier_it_is(name):
    rig, rng = read_rig(name), np.random.default_rng(5)
    case = workshop_case(rig, rng)
    node = rig.plan.held_out_node
    masses = [share * rig.mass for share in (0.02, 0.06)]
    small, large = (size_ratio(rig, case, Effect("attached_mass", {"mass": m}, node), rng) for m in masses)
    assert small > 1
    assert_allclose(large / small, 3.0, rtol=0.15)


def test_a_linear_effect_beside_a_nonlinear_one_is_no_part_of_its_size():
    """What the runs show of a rub that is never touched is nothing, whatever else is in the rig."""
    rig, rng = read_rig("spindle"), np.random.default_rng(6)
    case = workshop_case(rig, rng)
    beside = (Effect("attached_mass", {"mass": 0.1 * rig.mass}, 6), Effect("sensor_gain", {"gain": 1.2}, 3))
    rub = Effect("rub", {"stiffness": 1e5, "gap": 1.0}, 4)
    touching = replace(case, effects=(rub, *beside), repeats=0)
    runs = measure(rig, touching, rig.drive_node, touching.levels, rng)
    assert shown_size(rig, touching, runs) < 0.1


def test_what_an_effect_replaces_is_as_it_is_believed():
    rig = read_rig("pump-overhung")
    case = replace(workshop_case(rig, np.random.default_rng(0)), stated={"shaft_damping_ratio": 0.0123})
    assert replaced(case, ("shaft_damping",), rig).zeta == 0.0123
    assert replaced(case, ("bearing_damping",), rig).c_b == rig.c_b
    assert replaced(case, ("attached_mass",), rig) == case
    assert {"shaft_damping", "bearing_damping"} <= set(LINEAR)


# -- which effect is taken, without measuring its size ----------------------------------------------------


@pytest.fixture
def draws(monkeypatch):
    """Stands in for what is drawn: sizes by name, 5 where none is given; a size of 0 cannot be seen."""
    sizes: dict[str, float] = {}

    def stand_in(rig, case, name, wanted, rng, *, attempts):
        if not sizes.get(name, 5.0):
            raise ValueError("cannot be seen")
        return Draw(replace(case, effects=(Effect(name, {}),), levels=(1.0, 2.0, 3.0)), (sizes.get(name, 5.0),))

    monkeypatch.setattr(real_rigs, "draw_sized", stand_in)
    return sizes


def test_an_effect_that_cannot_have_the_size_is_passed_over(draws):
    rig, rng = read_rig("spindle"), np.random.default_rng(0)
    draws |= dict.fromkeys([*LINEAR, *CHAIN], 0.0) | {"axial_load": 4.0, "open_crack": 40.0}
    assert KINDS_OF_CAMPAIGN.index("large") == 1
    assert KINDS_OF_CAMPAIGN.index("small") == 3
    for index, name in ((1, "open_crack"), (3, "axial_load")):
        assert [e.id for e in draw_real(rig, index, rng).case.effects] == [name]
    draws["open_crack"] = 0.0
    assert draw_real(rig, 1, rng).ratios == (4.0,)  # none is large: the one that can be seen
    draws["axial_load"] = 0.0
    with pytest.raises(ValueError, match="can be seen in this rig"):
        draw_real(rig, 1, rng)


@pytest.mark.parametrize("kind", ["nonlinear", "beside"])
def test_nonlinear_effects_have_three_levels_and_no_repeat(draws, kind):
    rig, index = read_rig("spindle"), KINDS_OF_CAMPAIGN.index(kind)
    for seed in range(30):
        case = draw_real(rig, index, np.random.default_rng(seed)).case
        first, *beside = case.effects
        assert (len(case.levels), case.repeats, first.is_nonlinear) == (3, 0, True)
        assert len(beside) == (kind == "beside")
        assert not any(e.is_nonlinear or e.id in real_rigs.NOT_BESIDE for e in beside)


def test_pairs_do_not_join_what_needs_both_planes_with_what_acts_along_the_force(draws):
    rig = read_rig("spindle")
    for seed in range(200):
        names = {e.id for e in draw_real(rig, 2, np.random.default_rng(seed)).case.effects}
        assert len(names) == 2
        assert names != real_rigs.BOTH_PLANES
        assert not names & set(real_rigs.LEFT_OUT)
