"""Static condensation of the rotations: exact for stiffness, close for low modes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.reproduction.condensation import condense_tilt
from rigtwin.rotor.frequency.modal import damped_modes, natural_frequencies_hz
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import DOF_PER_NODE
from tests.rotor import rigs
from tests.tolerances import EIGENVALUE_ROUND_OFF, NEARLY_MASSLESS, ROUND_OFF, TABLE_1_PROGRAM

each_condition = pytest.mark.parametrize("condition", [rigs.RIGID, Condition(k_b=1e6)], ids=["rigid", "bearing"])


@each_condition
def test_only_deflections_are_left(condition):
    system = rigs.paper_system(condition)
    condensed = condense_tilt(system)
    assert set(condensed.free) == {dof for dof in system.free if dof % DOF_PER_NODE < 2}
    assert condensed.M.shape == (condensed.n, condensed.n)


@each_condition
def test_static_deflections_are_unchanged(condition):
    system = rigs.paper_system(condition)
    deflections = []
    for s in (system, condense_tilt(system)):
        force, read_out = rigs.driving_point(s)
        deflections.append(read_out @ np.linalg.solve(s.K, force))
    assert_allclose(deflections[1], deflections[0], rtol=0, atol=ROUND_OFF * np.abs(deflections[0]).max())


@each_condition
def test_condensation_raises_every_frequency(condition):
    """A constraint cannot lower a frequency (Rayleigh)."""
    system = rigs.paper_system(condition)
    full, condensed = (natural_frequencies_hz(s, plane=1) for s in (system, condense_tilt(system)))
    assert (condensed >= full[: len(condensed)] * (1 - EIGENVALUE_ROUND_OFF)).all()


@each_condition
def test_the_first_two_frequencies_hardly_change(condition):
    system = rigs.paper_system(condition)
    full, condensed = (natural_frequencies_hz(s, plane=1)[:2] for s in (system, condense_tilt(system)))
    # Rotary inertia of the 20 mm shaft: (pi d / 4 L)^2, one part in a thousand of the mass at most.
    assert_allclose(condensed, full, rtol=1e-4)


def test_condensation_is_exact_when_only_point_masses_have_inertia():
    tables = rigs.tables()
    tables["segment"][0].update(rigs.LIGHT_STEEL)
    beam = Rig.model_validate(tables)
    system = rigs.held(beam, elements=1, condition=rigs.RIGID)
    full, condensed = (natural_frequencies_hz(s, plane=1)[:2] for s in (system, condense_tilt(system)))
    assert_allclose(condensed, full, rtol=NEARLY_MASSLESS)


def test_the_papers_condensed_program_gives_table_1():
    printed = rigs.PAPER["table1"]
    for row, k_b in enumerate(printed["k_b"]):
        system = condense_tilt(rigs.paper_system(rigs.paper_condition(k_b)))
        theirs = [printed["program_f1"][row], printed["program_f2"][row]]
        assert_allclose(natural_frequencies_hz(system, plane=1)[:2], theirs, rtol=TABLE_1_PROGRAM)


def test_the_damping_ratio_survives_condensation():
    system = condense_tilt(rigs.paper_system(Condition(rigid_support=True, shaft_damping_ratio=0.01)))
    assert_allclose(damped_modes(system).damping_ratio, 0.01, rtol=EIGENVALUE_ROUND_OFF)


def test_a_bearing_damper_survives_condensation():
    condition = Condition(k_b=1e6, bearing_damping=20.0, shaft_damping_ratio=0.0)
    system = build_system(rigs.paper_structure(), condition)
    condensed = condense_tilt(system)
    kept = system.free % DOF_PER_NODE < 2
    assert_allclose(condensed.C, system.C[np.ix_(kept, kept)], rtol=0, atol=1e-12)
