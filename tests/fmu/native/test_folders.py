"""A host may unpack an FMU into a folder of any name: what has to be escaped in a URI must not crash it."""

from __future__ import annotations

import pytest

from tests.fmu.child import in_child

NAMES = ("with space", "mit-ümläut", "日本", "a%20b", "50%", "plus+sign", "hash#1", "paren(1)", "quote'q", "q?x")


def last_reading(fmu, folder, output):
    from fmpy import extract, simulate_fmu

    unpacked = extract(fmu, folder)
    driven = {"force_amplitude": 1.0} if output.startswith("node") else {"delta_f1": 5.0}
    options = {"stop_time": 0.01, "step_size": 1e-3, "output_interval": 1e-3}
    return float(simulate_fmu(unpacked, start_values=driven, output=[output], **options)[output][-1])


@pytest.mark.parametrize("name", NAMES)
def test_it_runs_from_a_folder_of_any_name(rotor_fmu, tmp_path, name):
    """In a child: the crash that this is about is a segmentation fault."""
    found = in_child(last_reading, rotor_fmu, tmp_path / name / "x", "node_2.acceleration_y")
    assert abs(found) > 0.1
    assert found == in_child(last_reading, rotor_fmu, tmp_path / "plain", "node_2.acceleration_y")


def test_the_estimator_runs_from_there_too(estimator_fmu, tmp_path):
    assert in_child(last_reading, estimator_fmu, tmp_path / "mit-ümläut #1 100%" / "x", "k_b") > 1e6


def both_from_there(rotor, estimator, folder):
    """Both in one process, one after the other and side by side."""
    from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu

    unpacked = [extract(fmu, f"{folder}/{k}") for k, fmu in enumerate((rotor, estimator))]
    kept = [instantiate_fmu(place, read_model_description(place)) for place in unpacked]
    driven = {"force_amplitude": 1.0}
    moved = simulate_fmu(unpacked[0], stop_time=0.01, start_values=driven, output=["node_2.acceleration_y"])
    estimate = simulate_fmu(unpacked[1], stop_time=1.0, output=["k_b"])
    for instance in kept:
        instance.freeInstance()
    return [float(abs(moved["node_2.acceleration_y"]).max()), float(estimate["k_b"][-1])]


def test_both_fmus_share_a_process_from_there(rotor_fmu, estimator_fmu, tmp_path):
    """Each has its own copy of pythonfmu's library, though the loader knows libraries by their names."""
    moved, estimate = in_child(both_from_there, rotor_fmu, estimator_fmu, tmp_path / "hash#1")
    assert moved > 0.1
    assert estimate > 1e6
