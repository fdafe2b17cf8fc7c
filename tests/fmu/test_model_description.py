"""What an importing tool reads before it runs anything."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fmpy.validation import validate_fmu

FMUTOOL = Path(sys.executable).with_name("fmutool")


def description(fmu: Path) -> ElementTree.Element:
    with zipfile.ZipFile(fmu) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml"))


def variables(fmu: Path) -> list[ElementTree.Element]:
    return description(fmu).findall("ModelVariables/ScalarVariable")


def reals(fmu: Path) -> dict[str, ElementTree.Element]:
    """The <Real> of every Real variable, by variable name."""
    return {v.attrib["name"]: v[0] for v in variables(fmu) if v[0].tag == "Real"}


def fmutool_report(fmu: Path) -> list[tuple[str, str]]:
    """(level, message) of every line of ``fmutool -check``; its exit code says nothing."""
    finished = subprocess.run([FMUTOOL, "-input", fmu, "-check"], capture_output=True, text=True, check=False)
    lines = (finished.stdout + finished.stderr).splitlines()
    return [(level.strip(), text.strip()) for level, _, text in (line.partition("|") for line in lines)]


def test_fmpy_finds_nothing_wrong(fmu):
    assert validate_fmu(str(fmu)) == []


def test_fmutool_finds_it_compliant_and_without_semantic_error(fmu):
    report = fmutool_report(fmu)
    assert {level for level, _ in report} == {"INFO"}
    messages = [message for _, message in report]
    assert "This FMU seems to be compliant with FMI-2.0." in messages
    assert "No semantic error against the FMI-2 standard." in messages


def test_fmutool_would_have_seen_a_wrong_description(rotor_fmu, tmp_path):
    """Negative control: a reader of reports that never sees an error guards nothing."""
    broken = tmp_path / "broken.fmu"
    with zipfile.ZipFile(rotor_fmu) as intact, zipfile.ZipFile(broken, "w") as archive:
        for name in intact.namelist():
            content = intact.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'causality="input"', b'causality="entrance"')
            archive.writestr(name, content)
    assert {level for level, _ in fmutool_report(broken)} & {"ERROR", "WARNING", "CRITICAL"}
    assert validate_fmu(str(broken))


def test_every_real_has_a_unit_and_every_unit_is_defined_in_si(fmu):
    units = {name: real.get("unit") for name, real in reals(fmu).items()}
    assert [name for name, unit in units.items() if not unit] == []
    defined = {unit.attrib["name"]: unit.find("BaseUnit") for unit in description(fmu).findall("UnitDefinitions/Unit")}
    assert set(units.values()) == set(defined)
    assert all(base is not None for base in defined.values())


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("N", {"kg": "1", "m": "1", "s": "-2"}),
        ("N/m", {"kg": "1", "s": "-2"}),
        ("N.s/m", {"kg": "1", "s": "-1"}),
        ("m/s2", {"m": "1", "s": "-2"}),
        ("Hz", {"s": "-1"}),
        ("rad/s", {"rad": "1", "s": "-1"}),
    ],
)
def test_units_have_the_exponents_of_their_si_base_units(rotor_fmu, unit, exponents):
    """Written out here: an importer converts with them, and would convert wrongly without a word."""
    (found,) = (u for u in description(rotor_fmu).iter("Unit") if u.attrib["name"] == unit)
    assert found.find("BaseUnit").attrib == exponents


def test_every_start_value_lies_in_its_range(fmu):
    for variable in variables(fmu):
        start, low, high = (variable[0].get(key) for key in ("start", "min", "max"))
        if start is not None and variable[0].tag != "Boolean":
            assert float(low or "-inf") <= float(start) <= float(high or "inf"), variable.attrib["name"]


def test_every_numeric_parameter_has_both_ends_of_a_range(rotor_fmu):
    parameters = [v for v in variables(rotor_fmu) if v.get("causality") == "parameter" and v[0].tag != "Boolean"]
    assert parameters
    assert [v.attrib["name"] for v in parameters if None in (v[0].get("min"), v[0].get("max"))] == []


@pytest.mark.parametrize("name", ["k_b"])
def test_what_must_be_positive_has_a_positive_minimum(rotor_fmu, name):
    assert float(reals(rotor_fmu)[name].attrib["min"]) > 0


@pytest.mark.parametrize("name", ["force_amplitude", "force_frequency", "bearing_damping", "shaft_damping_ratio"])
def test_what_must_not_be_negative_has_the_minimum_zero(rotor_fmu, name):
    assert float(reals(rotor_fmu)[name].attrib["min"]) == 0


def test_standard_errors_have_the_minimum_zero(estimator_fmu):
    errors = {name: real.get("min") for name, real in reals(estimator_fmu).items() if name.endswith("_std")}
    assert {name: low for name, low in errors.items() if name != "k_b_std" and low != "0"} == {}


def test_inputs_and_parameters_have_start_values_and_outputs_are_calculated(fmu):
    for variable in variables(fmu):
        calculated = variable.get("causality") == "output"
        assert ("start" in variable[0].attrib) is not calculated, variable.attrib["name"]
        assert (variable.get("initial") == "calculated") is calculated, variable.attrib["name"]


def test_everything_is_described(fmu):
    assert description(fmu).get("description")

    assert [v.attrib["name"] for v in variables(fmu) if not v.get("description")] == []


def test_the_description_of_a_rotor_names_its_rig(rotor_fmu):
    assert description(rotor_fmu).attrib["description"].endswith("(rig nit-rourkela)")


@pytest.mark.parametrize("group", ["Outputs", "InitialUnknowns"])
def test_every_output_states_what_it_depends_on(fmu, group):
    table = variables(fmu)
    outputs = [str(index) for index, v in enumerate(table, start=1) if v.get("causality") == "output"]
    unknowns = description(fmu).findall(f"ModelStructure/{group}/Unknown")
    assert [u.attrib["index"] for u in unknowns] == outputs
    for unknown in unknowns:
        known = [table[int(index) - 1].get("causality") for index in unknown.attrib["dependencies"].split()]
        assert known
        assert set(known) <= ({"input"} if group == "Outputs" else {"input", "parameter"})
        assert len(unknown.attrib["dependenciesKind"].split()) == len(known)


def test_its_capabilities_are_declared(fmu):
    declared = description(fmu).find("CoSimulation").attrib
    flags = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUstate", "canSerializeFMUstate")
    assert {declared[flag] for flag in flags} == {"true"}
    assert declared["canBeInstantiatedOnlyOncePerProcess"] == "false"
    # pythonfmu's glue cannot take the derivatives of inputs, and the estimator has no use for them
    compiled = declared["needsExecutionTool"] == "false"
    assert declared["canInterpolateInputs"] == str(compiled and fmu.stem == "RotorRig").lower()


@pytest.mark.parametrize(("name", "shown", "factor"), [("k_b", "MN/m", 1e-6), ("spin_speed", "rpm", 9.549296585513721)])
def test_people_read_it_in_the_units_of_the_workshop(rotor_fmu, name, shown, factor):
    real = reals(rotor_fmu)[name]
    assert real.get("displayUnit") == shown
    (unit,) = (u for u in description(rotor_fmu).iter("Unit") if u.get("name") == real.get("unit"))
    (display,) = unit.findall("DisplayUnit")
    assert display.get("name") == shown
    assert float(display.attrib["factor"]) == pytest.approx(factor, rel=1e-15)


def test_the_default_experiment_has_the_recommended_step_and_a_tolerance(rotor_fmu, estimator_fmu):
    rotor, estimator = (description(fmu).find("DefaultExperiment").attrib for fmu in (rotor_fmu, estimator_fmu))
    assert (float(rotor["stepSize"]), float(rotor["tolerance"])) == (2e-5, 3e-5)
    assert float(estimator["tolerance"]) == 1e-6


def test_it_holds_its_licences_and_says_what_it_needs(fmu):
    with zipfile.ZipFile(fmu) as archive:
        needs = archive.read("documentation/externalDependencies.txt").decode()
        licences = {name: archive.read(name).decode() for name in archive.namelist() if "/licenses/" in name}
    assert "MIT License" in licences["documentation/licenses/license.txt"]
    assert len(licences) == 2
    assert all("Copyright" in text for text in licences.values())
    python = description(fmu).find("CoSimulation").get("needsExecutionTool") == "true"
    assert ("numpy" in needs) == python


def test_it_carries_no_date(fmu):
    """A date would make every build another file."""
    assert "generationDateAndTime" not in description(fmu).attrib


def test_its_picture_is_a_png(fmu):
    with zipfile.ZipFile(fmu) as archive:
        picture = archive.read("model.png")
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert picture.endswith(b"IEND\xaeB`\x82")
    width, height = struct.unpack(">II", picture[16:24])
    assert min(width, height) >= 200


def page(fmu: Path) -> str:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read("documentation/index.html").decode()


@pytest.mark.parametrize("subject", ["communication step", "settling", "feedthrough", "algebraic loop"])
def test_the_rotors_page_speaks_of(rotor_fmu, subject):
    assert subject in page(rotor_fmu).lower()


def test_the_page_lists_every_variable(fmu):
    text = page(fmu)
    assert [v.attrib["name"] for v in variables(fmu) if f"<code>{v.attrib['name']}</code>" not in text] == []


def test_every_file_of_the_archive_unpacks(fmu, tmp_path):
    shutil.unpack_archive(fmu, tmp_path, format="zip")
    name = description(fmu).attrib["modelName"]
    assert (tmp_path / "binaries" / "linux64" / f"{name}.so").stat().st_size > 0
    assert (tmp_path / "documentation" / "index.html").stat().st_size > 0
