"""The modal form of a run against the rotor's own solver, and what drifts and tolerances do to it."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.linear import MODES
from rigtwin.gap.model.tolerances import sensitivity_of
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.effects import (
    EFFECTS,
    AttachedMass,
    AxialLoad,
    BearingCubic,
    CompliantRigidSupport,
    DiskInertia,
    FastSweep,
    ForceDropout,
    HubStiffening,
    PedestalFlexibility,
    PlaneAnisotropy,
    SensorGain,
    ViscoelasticSupport,
)
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Joint, load_rig
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import (
    BELIEF,
    ELEMENTS,
    K_B,
    LINEAR,
    STRUCTURE,
    TOLERANCES,
    WORKSHOP,
    blank,
    condition,
    lines,
    rebuilt,
    truth,
    workshop,
)

# A workshop that knows everything: no tolerance bends a mode.
EXACT = workshop(replace(BELIEF, modulus_tolerance=0.0, span_tolerance=0.0, disk_mass_tolerance=0.0))

# Resonances are narrow: what they say must be right to this share of a channel's peak.
CLOSE = 1e-4


@pytest.fixture(scope="module")
def forward():
    return Forward(WORKSHOP)


@pytest.fixture(scope="module")
def tolerant():
    """A model that knows what the workshop's tolerances do to both runs."""
    model = Forward(WORKSHOP)
    return model


def off(H, expected):
    """Largest error of a channel over its peak; channels that are held still do not count."""
    peak = np.abs(expected).max(axis=0)
    moving = peak > 1e-6 * peak.max()
    return float((np.abs(H - expected).max(axis=0)[moving] / peak[moving]).max())


def acting(name):
    """An effect at its start values, at a node in the middle of the shaft."""
    return EFFECTS[name](**({"node": 3} if "node" in EFFECTS[name].roles() else {}))


# -- against the rotor's own solver ----------------------------------------------------------------


@pytest.mark.parametrize("support", ["rigid", "bearing"])
@pytest.mark.parametrize("name", [name for name in LINEAR if name != "fast_sweep"])
def test_every_linear_effect_agrees_with_the_rotor(forward, name, support):
    effect = acting(name)
    run = blank(support, lines(support, [effect]))
    assert off(forward.modal(run, K_B, [effect]).response(), truth(run, [effect])) < CLOSE


@pytest.mark.parametrize("relaxation_time", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("k_b", [3e5, 2e7])
def test_a_strong_relaxing_support_agrees_too(forward, k_b, relaxation_time):
    effect = ViscoelasticSupport(strength=2.0, relaxation_time=relaxation_time)
    run = blank("bearing", lines("bearing", [effect]))
    assert off(forward.modal(run, k_b, [effect]).response(), truth(run, [effect], k_b=k_b)) < CLOSE


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_every_quantity_agrees(forward, quantity):
    run = blank("bearing", lines("bearing"), quantity=quantity, excitation_node=4)
    assert off(forward.modal(run, K_B).response(), truth(run)) < CLOSE


def test_at_constant_current_the_force_drops(forward):
    effect = ForceDropout()
    run = blank("bearing", lines("bearing", [effect]), quantity="acceleration", force_amplitude_N=3.0)
    expected = truth(run, [effect])
    assert off(forward.modal(run, K_B, [effect]).response(), expected) < CLOSE
    assert off(truth(run), expected) > 0.1


def test_a_channel_across_the_force_agrees(forward):
    effect = PlaneAnisotropy(anisotropy=0.3, angle=0.4)
    across = (Channel(2, "z"), Channel(4, "z"))
    run = blank("bearing", lines("bearing", [effect]), channels=across)
    expected = measured_response(STRUCTURE, condition("bearing"), [effect], run.frequency_hz, [2, 4], plane=2)
    assert off(forward.modal(run, K_B, [effect]).response(), expected) < CLOSE


def test_several_effects_act_together(forward):
    effects = [AttachedMass(mass=0.2, node=5), SensorGain(gain=1.2, node=2)]
    run = blank("bearing", lines("bearing", effects))
    assert off(forward.modal(run, K_B, effects).response(), truth(run, effects)) < CLOSE


# -- drifts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [0, 1])
def test_a_drift_moves_its_resonance_and_no_other(forward, mode):
    own = forward.modal(blank("bearing", lines("bearing")), K_B).frequencies_hz
    drift = np.zeros(MODES)
    drift[mode] = 2e-3
    for m in (0, 1):
        f = own[m] * (1 + np.linspace(-8e-3, 8e-3, 1601))
        modal = forward.modal(blank("bearing", f, channels=(Channel(3),)), K_B)
        before, after = (f[np.argmax(np.abs(H[:, 0]))] for H in (modal.response(), modal.response(drift)))
        assert_allclose(after / before - 1, drift[m], atol=3e-5)


@pytest.mark.parametrize("support", ["rigid", "bearing"])
def test_a_drift_of_all_resonances_is_another_frequency_axis(forward, support):
    run = blank(support, lines(support))
    moved = forward.modal(run, K_B).response(np.full(MODES, 1e-4))
    # Heights of peaks change by twice the drift, and so does what modes above the lines leave.
    assert off(moved, truth(run, drift=1e-4)) < 3e-4
    assert off(truth(run), truth(run, drift=1e-4)) > 5e-3


@pytest.mark.parametrize("mode", [0, 1])
def test_a_drift_of_a_damping_widens_its_resonance_and_no_other(forward, mode):
    """Peaks of a sum of resonances are as high as their dampings are small; where they stand does not change."""
    own = forward.modal(blank("bearing", lines("bearing")), K_B).frequencies_hz
    drift = np.zeros(MODES, dtype=complex)
    drift[mode] = 0.02j
    for m in (0, 1):
        f = own[m] * (1 + np.linspace(-4e-3, 4e-3, 1601))
        modal = forward.modal(blank("bearing", f, channels=(Channel(3),)), K_B)
        before, after = (np.abs(H[:, 0]) for H in (modal.response(), modal.response(drift)))
        assert_allclose(before.max() / after.max() - 1, drift[m].imag, atol=2e-4)
        assert np.argmax(before) == pytest.approx(np.argmax(after), abs=2)


def test_between_resonances_the_drift_of_the_next_one_above_is_seen(forward):
    """The third resonance lies above the lines; where the response nearly vanishes it drifts beyond what errors are."""
    run = blank("bearing", np.linspace(200, 400, 801), channels=(Channel(2),))
    modal = forward.modal(run, K_B)
    assert modal.frequencies_hz[2] > run.frequency_hz[-1]
    H, moved = modal.response(), modal.response(2e-4 * np.eye(MODES)[2])
    assert np.max(np.abs(moved / H - 1)) > 10 * 1e-4


# -- derivatives -----------------------------------------------------------------------------------


@pytest.mark.parametrize("support", ["rigid", "bearing"])
@pytest.mark.parametrize(
    ("effect", "quantity"),
    [
        (AttachedMass(mass=0.05, node=5), "accelerance"),
        (ForceDropout(mass=0.1, stiffness=1e4, damping=10.0), "acceleration"),
        (FastSweep(dwell=0.3), "accelerance"),
    ],
)
def test_derivatives_are_finite_differences(tolerant, support, effect, quantity):
    rng = np.random.default_rng(1)
    modal = tolerant.modal(blank(support, lines(support), quantity=quantity), K_B, [effect])
    at, step = rng.standard_normal(2 * MODES + len(TOLERANCES)) * 1e-4, 1e-7

    def response(x):
        frequency, damping, tolerance = np.split(x, [MODES, 2 * MODES])
        return modal.response(frequency + 1j * damping, 5 * tolerance)

    frequency, damping, tolerance = np.split(at, [MODES, 2 * MODES])
    H, D = modal.with_derivatives(frequency + 1j * damping, 5 * tolerance)
    D[2 * MODES :] *= 5
    assert_allclose(H, response(at))
    for k, derivative in enumerate(D):
        up, down = at.copy(), at.copy()
        up[k], down[k] = at[k] + step, at[k] - step
        difference = (response(up) - response(down)) / (2 * step)
        assert np.abs(derivative - difference).max() <= 1e-4 * np.abs(difference).max() + 1e-6


@pytest.mark.parametrize("effects", [(), (DiskInertia(factor=0.5),), (ForceDropout(mass=0.1, stiffness=1e4),)])
def test_a_change_through_the_poles_is_a_derivative(tolerant, effects):
    """Also for a step that shifts a resonance by a tenth of its width, where a plain difference is none."""
    quantity = "acceleration" if any(e.id == "force_dropout" for e in effects) else "accelerance"
    run = blank("bearing", lines("bearing"), quantity=quantity)
    drift, tolerance = np.full(MODES, 1e-4), np.full(len(TOLERANCES), 3e-4)

    def at(ln_k_b):
        return tolerant.modal(run, np.exp(ln_k_b), effects)

    here, step, small = np.log(K_B), 1e-3, 1e-6
    up, down = (at(here + s).response(drift, tolerance) for s in (small, -small))
    derivative = (up - down) / (2 * small)
    through_poles = at(here).change_to(at(here + step), drift, tolerance) / step
    plain = (at(here + step).response(drift, tolerance) - at(here).response(drift, tolerance)) / step
    size = np.abs(derivative).max()
    assert np.abs(through_poles - derivative).max() < 0.01 * size
    assert np.abs(plain - derivative).max() > 0.03 * size


def test_modes_that_are_not_one_to_one_fall_back_to_a_plain_difference(tolerant):
    run, nothing = blank("bearing", lines("bearing")), (np.zeros(MODES), np.zeros(len(TOLERANCES)))
    one, other = tolerant.modal(run, K_B), tolerant.modal(run, K_B, [PlaneAnisotropy(anisotropy=0.3, angle=0.5)])
    assert_allclose(one.change_to(other, *nothing), other.response() - one.response())


# -- tolerances ------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-3, -1e-3])
@pytest.mark.parametrize("support", ["rigid", "bearing"])
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_a_tolerance_is_what_a_rebuilt_rig_does(tolerant, tolerance, support, size):
    run = blank(support, lines(support))
    structure = assemble(rebuilt(tolerance, size), elements_between_nodes=ELEMENTS)
    expected = measured_response(structure, condition(support), (), run.frequency_hz)
    given = tolerant.modal(run, K_B).response(None, size * np.eye(len(TOLERANCES))[TOLERANCES.index(tolerance)])
    change = np.abs(expected - truth(run)).max()
    assert change > 0.01 * np.abs(expected).max()
    assert np.abs(given - expected).max() < 0.05 * change


@pytest.mark.parametrize("drive", [2, 4])
@pytest.mark.parametrize("support", ["rigid", "bearing"])
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_a_tolerance_acts_beside_an_effect(tolerance, support, drive):
    """Driven at midspan the nominal rotor has modes that do not move; with a mass on one side they do."""
    size, effect = 1e-3, AttachedMass(mass=0.1, node=3)
    run = blank(support, lines(support, [effect]), excitation_node=drive)
    model = Forward(WORKSHOP)
    structure = assemble(rebuilt(tolerance, size), elements_between_nodes=ELEMENTS)
    expected = measured_response(structure, condition(support, drive), [effect], run.frequency_hz)
    given = model.modal(run, K_B, [effect]).response(None, size * np.eye(len(TOLERANCES))[TOLERANCES.index(tolerance)])
    assert np.abs(given - expected).max() < 0.1 * np.abs(expected - truth(run, [effect])).max()


@pytest.mark.parametrize(
    "effect", [DiskInertia(factor=1.0), HubStiffening(factor=2.0), CompliantRigidSupport(), AxialLoad(force=-5000.0)]
)
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_a_tolerance_acts_as_it_does_under_the_effect(tolerance, effect):
    size, support = 1e-3, "rigid" if effect.location == "rigid_support" else "bearing"
    run = blank(support, lines(support, [effect]))
    model = Forward(WORKSHOP)
    model.bend(run, K_B, [effect])
    structure = assemble(rebuilt(tolerance, size), elements_between_nodes=ELEMENTS)
    expected = measured_response(structure, condition(support), [effect], run.frequency_hz)
    given = model.modal(run, K_B, [effect]).response(None, size * np.eye(len(TOLERANCES))[TOLERANCES.index(tolerance)])
    assert np.abs(given - expected).max() < 0.01 * np.abs(expected - truth(run, [effect])).max()


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_a_tolerance_changes_how_much_the_bearings_damp(tolerance):
    """A stiffer shaft moves more in its bearings: by as much the dashpots there take from each mode."""
    size, here = 1e-4, condition("bearing")
    run = blank("bearing", lines("bearing"))
    model = Forward(WORKSHOP)
    structure = assemble(rebuilt(tolerance, size), elements_between_nodes=ELEMENTS)
    before, after = (damped_modes(build_system(each, here, ())).damping_ratio[:4:2] for each in (STRUCTURE, structure))
    relative = model.modal(run, K_B).sensitivity[:2, TOLERANCES.index(tolerance)] * size
    # lambda = i omega e^(i asin zeta), every mode once in each plane
    assert_allclose(relative.imag, after - before, rtol=0.02, atol=1e-4 * size)


def test_tolerances_let_the_exciter_reach_a_mode_that_it_hardly_reached():
    """A pedestal's mode has a node near the exciter, so a longer rotor changes its height by a large share."""
    size, effect = 1e-3, PedestalFlexibility(stiffness=2.26e6, mass=3.37, damping=2.4)
    modes = damped_modes(build_system(STRUCTURE, condition("bearing"), [effect]))
    f = modes.frequency_hz[np.argmin(np.abs(modes.frequency_hz - 152.3))]
    run = blank("bearing", f * (1 + np.linspace(-0.02, 0.02, 81)))
    structure = assemble(rebuilt("span", size), elements_between_nodes=ELEMENTS)
    expected, plain = (
        measured_response(each, condition("bearing"), [effect], run.frequency_hz) for each in (structure, STRUCTURE)
    )
    model = Forward(WORKSHOP)
    model.bend(run, K_B, [effect])
    given = model.modal(run, K_B, [effect]).response(None, size * np.eye(len(TOLERANCES))[TOLERANCES.index("span")])
    assert np.abs(given - expected).max() < 0.02 * np.abs(expected - plain).max()


# -- fast sweeps -----------------------------------------------------------------------------------


def test_a_long_dwell_is_a_steady_response(forward):
    run = blank("bearing", lines("bearing"))
    steady = truth(run)
    errors = [off(forward.modal(run, K_B, [FastSweep(dwell=dwell)]).response(), steady) for dwell in (0.1, 1.0, 30.0)]
    assert errors[0] > 0.1
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < CLOSE


def test_a_fast_sweep_is_what_integration_in_time_gives(forward):
    """The rotor from rest under a sine of continuous phase, read over one period after each dwell."""
    dwell, f = 0.1, np.array([85.0, 90.0, 94.0, 97.0, 100.0, 250.0, 300.0])
    run = blank("rigid", f, channels=(Channel(2), Channel(4)))
    system = build_system(STRUCTURE, condition("rigid"), ()).in_plane(1)
    n, force = system.n, system.unit_vector(2, 1)
    A = np.zeros((2 * n + 2, 2 * n + 2))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, : 2 * n] = -np.linalg.solve(system.M, np.hstack([system.K, system.C]))
    A[n : 2 * n, 2 * n] = np.linalg.solve(system.M, force)  # the sine is a state of its own
    read, x = system.read_out(1)[[1, 3]], np.zeros(2 * n + 2)
    x[2 * n + 1], expected = 1.0, []
    for w in 2 * np.pi * f:
        A[2 * n, 2 * n + 1], A[2 * n + 1, 2 * n] = w, -w
        x = expm(A * dwell) @ x
        samples, step, motions = 2000, 2 * np.pi / w / 2000, [x]
        P = expm(A * step)
        for _ in range(samples):
            motions.append(P @ motions[-1])
        motions, x = np.array(motions), motions[-1]
        acceleration = (motions @ A.T)[:, n : 2 * n] @ read.T
        carrier = motions[:, 2 * n + 1] - 1j * motions[:, 2 * n]  # e^{-i theta}
        weights = np.full(samples + 1, 1.0)
        weights[[0, -1]] = 0.5
        expected.append(2j * (weights * carrier) @ acceleration / samples)
    modal = forward.modal(run, K_B, [FastSweep(dwell=dwell)])
    assert off(modal.response(), np.array(expected)) < 1e-3


@pytest.mark.parametrize("sweep", ["up", "down"])
def test_lines_left_out_of_a_fast_sweep_were_swept_all_the_same(forward, sweep):
    run, effects = blank("rigid", np.linspace(90, 110, 41), sweep=sweep), [FastSweep(dwell=0.1)]
    for some in (slice(None, None, 3), np.abs(np.arange(41) - 20) > 1):
        kept = forward.modal(run.on_lines(some).on_lines(slice(1, None, 2)), K_B, effects).response()
        assert_allclose(kept, forward.modal(run, K_B, effects).response()[some][1::2])


def test_a_fast_sweep_pulls_peaks_along(forward):
    run = blank("rigid", np.linspace(80.0, 120.0, 801), channels=(Channel(3),))
    H = {
        sweep: np.abs(
            forward.modal(
                blank("rigid", run.frequency_hz, channels=run.channels, sweep=sweep), K_B, [FastSweep(dwell=0.05)]
            ).response()[:, 0]
        )
        for sweep in ("up", "down")
    }
    steady = np.abs(forward.modal(run, K_B).response()[:, 0])
    up, down, settled = (run.frequency_hz[np.argmax(h)] for h in (H["up"], H["down"], steady))
    assert down < settled < up


@pytest.mark.parametrize(
    ("effects", "quantity", "sweep", "images"),
    [
        ((), "accelerance", "up", True),
        ((), "accelerance", "down", False),
        ((SensorGain(node=3, gain=1.2), AttachedMass(node=5)), "acceleration", "down", True),
    ],
)
def test_many_dwells_at_once_change_what_each_alone_changes(effects, quantity, sweep, images):
    run = blank("rigid", lines("rigid"), quantity=quantity, sweep=sweep)
    forward = Forward(WORKSHOP).made(images=images)
    drift, tolerance, dwells = np.full(MODES, 1e-4), np.full(len(TOLERANCES), -5e-4), np.array([0.05, 0.4, 3.0])
    together = forward.modal(run, K_B, effects).change_by_dwells(dwells, drift, tolerance)
    steady = forward.modal(run, K_B, effects).response(drift, tolerance)
    for change, dwell in zip(together, dwells, strict=True):
        alone = forward.modal(run, K_B, (*effects, FastSweep(dwell=dwell))).response(drift, tolerance)
        assert_allclose(change, alone - steady, atol=1e-12 * np.abs(alone).max())


def test_tolerances_of_a_stepped_shaft_are_meshed_as_the_rig():
    """Sections that change between nodes cut the mesh as well."""
    rig = load_rig("nit-rourkela")
    parts = [rig.segment[0].model_copy(update={"length_m": length}) for length in (0.05, 0.1, 0.12, 0.156)]
    made = Workshop(rig.model_copy(update={"segment": parts}), BELIEF, ELEMENTS, 8)
    anchor = made.anchor(np.zeros(len(made.tolerances)))
    assert {variant.n for variant in anchor.variants} == {anchor.structure.n}


def test_a_joint_moves_with_the_other_lengths():
    """A longer rotor has its joint as much farther along, and the mesh of the rig as drawn."""
    rig = load_rig("nit-rourkela").model_copy(update={"joint": [Joint(x_m=0.2131, tilt_stiffness_Nm_per_rad=2e4)]})
    made = Workshop(rig, BELIEF, ELEMENTS, 8)
    longer = made.structure(np.log(1.01) * (np.array(made.names) == "span"))
    assert_allclose(longer.x, 1.01 * made.structure(np.zeros(len(made.names))).x, rtol=1e-12)
    assert np.diff(longer.x).min() == 0.0


def test_a_joint_may_be_stiffer_than_its_rig_file_says():
    """Its springs alone, and the resonances as the strain in it tells; a rigid direction stays rigid."""
    size, bolted = 1e-3, Joint(node=4, tilt_stiffness_Nm_per_rad=2e4, tilt_damping_Nms_per_rad=0.1)
    made = Workshop(load_rig("nit-rourkela").model_copy(update={"joint": [bolted]}), BELIEF, ELEMENTS, 8)
    place = made.names.index("joint_1")
    assert made.std[place] == 0.3
    own = size * (np.arange(len(made.names)) == place)
    plain, stiffer = made.structure(np.zeros(len(own))), made.structure(own)
    assert_allclose(stiffer.joint_tilt_stiffness, 2e4 * np.exp(size), rtol=1e-12)
    assert np.isinf(stiffer.joint_stiffness).all()
    assert np.array_equal(stiffer.joint_tilt_damping, plain.joint_tilt_damping)
    run = blank("bearing", np.linspace(20, 400, 50))
    modal, there = (Forward(made).at(values).modal(run, K_B) for values in (np.zeros(len(own)), own))
    shifts = there.frequencies_hz / modal.frequencies_hz - 1
    assert shifts.max() > 1e-5
    alone = sensitivity_of(build_system(plain, condition("bearing")).in_plane(1), made.tolerances)
    assert_allclose(size * alone[: len(shifts), place].real, shifts, atol=0.01 * shifts.max())


def test_a_law_on_a_floating_rotor_follows_its_lengths():
    """Between soft springs, matrices to first order in the lengths would have a negative stiffness."""
    rig = load_rig("nit-rourkela")
    springs = [s.model_copy(update={"stiffness": 50.0}) for s in rig.support]
    bearing = rig.support[0].model_copy(update={"node": 4})
    floating = Forward(Workshop(rig.model_copy(update={"support": [*springs, bearing]}), BELIEF, ELEMENTS, 8))
    run = blank("bearing", np.linspace(60, 80, 5), force_amplitude_N=1.0)
    modal = floating.modal(run, 1e4, (BearingCubic(stiffness=1e9),))
    assert np.isfinite(modal.response(None, np.full(len(floating.anchor.values), 2e-3))).all()


def test_a_disk_may_be_of_another_inertia_where_the_model_has_one():
    """The pump's overhung disk: its mass stays, it tilts harder, and modes follow as a rebuilt rotor's do."""
    rig, size = load_rig("pump-overhung"), 1e-3
    made = Workshop(rig, BELIEF, ELEMENTS, 8)
    assert [name for name in made.names if "inertia" in name] == ["disk_inertia_2"]
    own = size * (np.array(made.names) == "disk_inertia_2")
    plain, heavier = made.structure(np.zeros(len(own))), made.structure(own)
    change = heavier.M - plain.M
    tilts = 4 * plain.disk_node[1] + np.array([2, 3])
    assert_allclose(change[tilts, tilts], np.expm1(size) * rig.disk[1].diametral_inertia, rtol=1e-9)
    assert np.count_nonzero(np.abs(change) > 1e-12) == 2
    run = blank("bearing", np.linspace(10, 330, 50))
    modal, there = (Forward(made).at(values).modal(run, 1e7) for values in (np.zeros(len(own)), own))
    shifts = there.frequencies_hz / modal.frequencies_hz - 1
    place = made.names.index("disk_inertia_2")
    assert_allclose(size * modal.sensitivity[: len(shifts), place].real, shifts, atol=1e-3 * np.abs(shifts).max())
    alone = sensitivity_of(build_system(plain, replace(condition("bearing"), k_b=1e7)).in_plane(1), made.tolerances)
    assert_allclose(size * alone[: len(shifts), place].real, shifts, atol=0.02 * np.abs(shifts).max())
    assert shifts.min() < -1e-4


@pytest.fixture
def solved(monkeypatch):
    """The rotors that have been solved since."""
    made = []

    def build(structure, condition, effects):
        made.append(effects)
        return build_model(structure, condition, effects)

    monkeypatch.setattr("rigtwin.gap.model.forward.build_model", build)
    return made


@pytest.mark.parametrize(
    ("support", "k_b", "effects", "rotors"),
    [
        pytest.param("rigid", 1.01 * K_B, (), 1, id="bearings that are not there"),
        pytest.param("rigid", K_B, (SensorGain(node=3),), 1, id="another gain"),
        pytest.param("bearing", K_B, (FastSweep(),), 1, id="a faster sweep"),
        pytest.param("bearing", 1.01 * K_B, (), 2, id="other bearings"),
        pytest.param("rigid", K_B, (AttachedMass(node=3),), 2, id="another mass"),
    ],
)
def test_a_rotor_is_solved_anew_where_it_changes(solved, support, k_b, effects, rotors):
    run, fresh = blank(support, lines(support)), Forward(EXACT)
    fresh.modal(run, K_B)
    H = fresh.modal(run, k_b, effects).response()
    assert len(solved) == rotors
    assert_allclose(H, Forward(EXACT).modal(run, k_b, effects).response(), rtol=1e-12)


def test_another_process_gets_no_rotors(solved):
    run, forward = blank("bearing", lines("bearing")), Forward(EXACT)
    H, empty = forward.modal(run, K_B).response(), len(pickle.dumps(Forward(EXACT)))
    there = pickle.loads(pickle.dumps(forward))
    assert len(pickle.dumps(forward)) == empty
    assert_allclose(there.modal(run, K_B).response(), H, rtol=1e-12)
    forward.modal(run, K_B)
    assert len(solved) == 2  # one here, one there


def test_both_kinds_of_model_answer_the_same_questions():
    """A linear response per newton is the same at every level; a law's is not, and has no sum of resonances."""
    run = blank("bearing", lines("bearing")[::16], force_amplitude_N=0.5, sweep="up")
    forward = Forward(WORKSHOP).made(with_data=False)
    linear, law = forward.modal(run, K_B), forward.modal(run, K_B, (BearingCubic(stiffness=1e14),))
    assert (linear.level_is_parameter, law.level_is_parameter) == (False, True)
    assert (linear.as_linear, linear.as_nonlinear, law.as_linear, law.as_nonlinear) == (linear, None, None, law)
    assert np.array_equal(linear.response(level=0.3), linear.response())
    assert not np.allclose(law.response(level=0.3), law.response(), rtol=1e-4)
    assert linear.tells().all()
    nothing = np.zeros(MODES), np.zeros(len(TOLERANCES))
    assert_allclose(linear.change_to(law, *nothing), law.response() - linear.response())
