"""Names, causalities, variabilities and start values that users rely on: extend, never rename or drop."""

from __future__ import annotations

from fmpy import read_model_description

# name: (type, causality, variability, start)
ROTOR = {
    "force": ("Real", "input", "continuous", 0.0),
    "force_amplitude": ("Real", "input", "continuous", 0.0),
    "force_frequency": ("Real", "input", "continuous", 100.0),
    "spin_speed": ("Real", "input", "continuous", 0.0),
    "k_b": ("Real", "parameter", "tunable", 1e7),
    "bearing_damping": ("Real", "parameter", "tunable", 0.0),
    "shaft_damping_ratio": ("Real", "parameter", "tunable", 0.001),
    "rigid_support": ("Boolean", "parameter", "fixed", False),
    "excitation_node": ("Integer", "parameter", "fixed", 2),
    "excitation_plane": ("Integer", "parameter", "fixed", 1),
    **{f"node_{n}.acceleration_{p}": ("Real", "output", "continuous", None) for p in "yz" for n in range(1, 8)},
    "force_applied": ("Real", "output", "continuous", None),
}
# Effect: its parameters; * fixed, the others tunable; # an integer, ``enabled`` a switch, the others numbers.
EFFECTS = """
attached_mass: enabled mass node# half_width
exciter_suspension: enabled stiffness damping
disk_mass: enabled change
disk_inertia: enabled factor
hub_stiffening: enabled factor
shaft_modulus: enabled factor
axial_load: enabled force
open_crack: enabled reduction position
measured_joint: enabled* stiffness mass damping node# branch_mass* branch_frequency* branch_damping_ratio* branch_ground_ratio*
shaft_damping: enabled damping_ratio
bearing_damping: enabled damping
bearing_tilt_stiffness: enabled stiffness
pedestal_flexibility: enabled* stiffness mass damping block_compliance* block_mass*
bearing_asymmetry: enabled asymmetry
bearing_offset: enabled offset
compliant_rigid_support: enabled* stiffness
plane_anisotropy: enabled anisotropy angle
viscoelastic_support: enabled* strength relaxation_time spread*
bearing_cubic: enabled stiffness
bearing_hertz: enabled preload
bearing_clearance: enabled gap preload
bearing_friction: enabled force stiffness spread
bilinear_support: enabled ratio
rub: enabled stiffness gap node#
joint_microslip: enabled angle exponent contact gap
sensor_mass: enabled mass node#
sensor_position: enabled offset node#
gyroscopic: enabled factor
unbalance: enabled moment phase node#
"""  # noqa: E501
ESTIMATOR = {
    **{name: ("Real", "input", "continuous") for name in ("delta_f1", "delta_f2", "amplitude_ratio")},
    **{f"{name}_std": ("Real", "input", "continuous") for name in ("delta_f1", "delta_f2", "amplitude_ratio")},
    **{name: ("Real", "output", "continuous") for name in ("k_b", "k_b_std", "k_b_low", "k_b_high")},
    "valid": ("Boolean", "output", "discrete"),
}


def start_value(variable):
    return {"Real": float, "Integer": int, "Boolean": lambda text: text == "true"}[variable.type](variable.start)


def declared(fmu):
    """name: (type, causality, variability, start) of every variable."""
    return {
        v.name: (v.type, v.causality, v.variability, None if v.start is None else start_value(v))
        for v in read_model_description(str(fmu)).modelVariables
    }


def test_the_rotor_has_the_variables_of_its_contract(rotor_fmu):
    found = declared(rotor_fmu)
    assert {name: found.get(name) for name in ROTOR} == ROTOR


def test_the_rotor_has_the_parameters_of_every_effect(rotor_fmu):
    found = declared(rotor_fmu)
    for line in EFFECTS.strip().splitlines():
        effect, names = line.split(": ")
        for name in names.split():
            plain = name.strip("*#")
            kind = "Boolean" if plain == "enabled" else "Integer" if "#" in name else "Real"
            variability = "fixed" if "*" in name else "tunable"
            assert found[f"{effect}.{plain}"][:3] == (kind, "parameter", variability), f"{effect}.{plain}"


def test_beyond_its_contract_the_rotor_has_only_effects_that_are_off(rotor_fmu):
    """``<effect id>.<parameter>``, and for every effect ``<effect id>.enabled``, false."""
    beyond = {name: facts for name, facts in declared(rotor_fmu).items() if name not in ROTOR}
    effects = {name.split(".")[0] for name in beyond}
    assert all("." in name and facts[1] == "parameter" for name, facts in beyond.items())
    assert all(beyond[f"{effect}.enabled"][3] is False for effect in effects)


def test_the_estimator_has_exactly_the_variables_of_its_contract(estimator_fmu):
    assert {name: facts[:3] for name, facts in declared(estimator_fmu).items()} == ESTIMATOR


def test_the_estimators_start_values_are_a_measurement_that_it_believes(estimator_session):
    estimator_session.start()
    low, k_b, high, valid = estimator_session.get(["k_b_low", "k_b", "k_b_high", "valid"])
    assert valid
    assert low < k_b < high


def test_both_are_co_simulation_fmus_of_fmi_2_that_take_any_step(fmu):
    description = read_model_description(str(fmu))
    assert description.fmiVersion == "2.0"
    assert description.modelExchange is None
    assert description.coSimulation.modelIdentifier == description.modelName == fmu.stem
