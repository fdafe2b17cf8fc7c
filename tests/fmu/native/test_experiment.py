"""What a host says of an experiment is kept: its end, the categories of its log, and the slopes of its inputs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave

H = 1e-3
CATEGORIES = ["logEvents", "logStatusWarning", "logStatusError"]


class Host:
    """An instance of either version, and all that it tells: (category, sentence)."""

    def __init__(self, fmu: Path, folder: Path, *, logging: bool = False):
        extract(str(fmu), str(folder))
        self.description = read_model_description(str(folder))
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}
        self.told: list[tuple[str, str]] = []
        options = {
            "guid": self.description.guid, "unzipDirectory": str(folder),
            "modelIdentifier": self.description.modelName, "instanceName": "one",
        }  # fmt: skip
        if self.description.fmiVersion == "2.0":
            self.fmu = FMU2Slave(**options)
            logger = fmi2CallbackLoggerTYPE(lambda _, __, ___, c, text: self.told.append((c.decode(), text.decode())))
            others = (defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory, defaultCallbacks.stepFinished)
            self.callbacks = fmi2CallbackFunctions(logger, *others, None)
            self.fmu.instantiate(callbacks=self.callbacks, loggingOn=logging)
            self.set, self.get = self.fmu.setReal, self.fmu.getReal
        else:
            self.fmu = FMU3Slave(**options)
            tell = lambda _, __, c, text: self.told.append((c.decode(), text.decode()))  # noqa: E731
            self.fmu.instantiate(logMessage=tell, loggingOn=logging)
            self.set, self.get = self.fmu.setFloat64, self.fmu.getFloat64

    def start(self, time: float = 0.0, stop: float | None = None) -> None:
        """Initialise."""
        if self.description.fmiVersion == "2.0":
            self.fmu.setupExperiment(startTime=time, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time, stopTime=stop)
        self.fmu.exitInitializationMode()

    def choose(self, on: bool, categories: list[str]) -> None:
        """setDebugLogging."""
        self.fmu.setDebugLogging(on, categories)

    def fail(self) -> None:
        """A call that fails."""
        with pytest.raises(FMICallException):
            self.set([self.reference["k_b"]], [-1.0])


@pytest.fixture(params=["rotor_fmu", "rotor3"])
def rotor(request) -> Path:
    return request.getfixturevalue(request.param)


def test_no_step_goes_beyond_the_stop_time(rotor, tmp_path):
    host = Host(rotor, tmp_path)
    host.set([host.reference["force_amplitude"]], [1.0])
    host.start(time=2.0, stop=2.0 + 3 * H)
    for k in range(3):
        host.fmu.doStep(2.0 + k * H, H)
    moved = host.get([host.reference["node_2.acceleration_y"]])
    with pytest.raises(FMICallException):
        host.fmu.doStep(2.0 + 3 * H, H)
    assert "a step to 2.004 s goes beyond the stop time of 2.003 s" in host.told[-1][1]
    assert host.get([host.reference["node_2.acceleration_y"]]) == moved != [0.0]
    host.fmu.reset()
    host.start()
    host.fmu.doStep(0.0, 10.0)  # a reset forgets the end, too


def test_a_stop_before_the_start_is_refused(rotor, tmp_path):
    host = Host(rotor, tmp_path)
    with pytest.raises(FMICallException):
        host.start(time=2.0, stop=1.0)
    assert "the stop time must not lie before the start time of 2 s, got 1 s" in host.told[-1][1]
    host.start(time=2.0, stop=4.0)


def test_it_tells_of_the_categories_that_its_description_lists(rotor, tmp_path):
    host = Host(rotor, tmp_path, logging=True)
    assert [c.name for c in host.description.logCategories] == CATEGORIES
    host.start()
    host.fail()
    host.fmu.terminate()
    assert [category for category, _ in host.told] == ["logEvents", "logStatusError", "logEvents"]
    assert "one: the simulation starts at 0 s" in host.told[0][1]


def test_without_debug_logging_only_failures_are_told(rotor, tmp_path):
    host = Host(rotor, tmp_path)
    host.start()
    host.fail()
    assert [category for category, _ in host.told] == ["logStatusError"]


@pytest.mark.parametrize(
    ("on", "categories", "expected"),
    [
        (True, [], ["logEvents", "logStatusError"]),
        (True, ["logEvents"], ["logEvents", "logStatusError"]),
        (False, [], []),
        (False, ["logStatusError"], []),
        (False, ["logEvents"], ["logStatusError"]),
    ],
)
def test_the_host_chooses_what_it_hears(rotor, tmp_path, on, categories, expected):
    host = Host(rotor, tmp_path)
    host.choose(on, categories)
    host.start()
    host.fail()
    assert [category for category, _ in host.told] == expected


def test_an_unknown_category_is_refused_by_its_name(rotor, tmp_path):
    host = Host(rotor, tmp_path)
    with pytest.raises(FMICallException):
        host.choose(True, ["logEvents", "logEverything"])
    assert "there is no log category logEverything" in host.told[-1][1]
    host.start()
    assert host.told[1:] == [], "a refused choice changes nothing"


# -- slopes of the force, FMI 2.0 ------------------------------------------------------------------


def sine_run(host: Host, h: float, frequency: float, *, slopes: bool) -> np.ndarray:
    """(n, 2) node 2 and the applied force under a sine of samples, with or without its slopes."""
    omega, force = 2 * np.pi * frequency, host.reference["force"]
    read = [host.reference["node_2.acceleration_y"], host.reference["force_applied"]]
    host.set([host.reference["shaft_damping_ratio"], host.reference["bearing_damping"]], [0.1, 200.0])
    host.start()
    rows = []
    for k in range(round(0.15 / h)):
        host.set([force], [np.sin(omega * k * h)])
        if slopes:
            host.fmu.setRealInputDerivatives([force], [1], [omega * np.cos(omega * k * h)])
        host.fmu.doStep(k * h, h)
        rows.append(host.get(read))
    return np.array(rows)


def test_slopes_that_the_master_gives_follow_the_force_closer(rotor_fmu, tmp_path):
    h, frequency, excess = 2e-4, 60.0, {}
    time = h * (np.arange(round(0.15 / h)) + 1)
    for slopes in (False, True):
        rows = sine_run(Host(rotor_fmu, tmp_path / str(slopes)), h, frequency, slopes=slopes)
        late = time > 0.05
        excess[slopes] = np.abs(rows[late, 1] - np.sin(2 * np.pi * frequency * time[late])).max()
    assert excess[False] > 5e-3
    assert excess[True] < 0.65 * excess[False]  # (omega h)^2 in place of 1.7 (omega h)^2


def test_a_slope_counts_for_one_step(rotor_fmu, tmp_path):
    host = Host(rotor_fmu, tmp_path)
    force, applied = host.reference["force"], host.reference["force_applied"]
    host.start()
    host.fmu.setRealInputDerivatives([force], [1], [100.0])
    host.fmu.doStep(0.0, H)
    assert host.get([applied]) == pytest.approx([100.0 * H])
    for k in range(1, 6):
        host.fmu.doStep(k * H, H)
    assert host.get([applied]) == pytest.approx([0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("name", "order", "slope", "words"),
    [
        ("force", 2, 1.0, "force takes its first derivative only, got order 2"),
        ("force", 1, np.nan, "the derivative of force must be a finite number"),
        ("k_b", 1, 1.0, "k_b is no input: it takes no derivative"),
        ("rigid_support", 1, 1.0, "there is no Real variable with value reference"),
    ],
)
def test_a_derivative_without_a_meaning_is_refused(rotor_fmu, tmp_path, name, order, slope, words):
    host = Host(rotor_fmu, tmp_path)
    host.start()
    with pytest.raises(FMICallException):
        host.fmu.setRealInputDerivatives([host.reference[name]], [order], [slope])
    assert words in host.told[-1][1]


def test_a_derivative_of_an_input_that_is_held_is_a_warning(rotor_fmu, tmp_path):
    host = Host(rotor_fmu, tmp_path)
    host.start()
    host.fmu.setRealInputDerivatives([host.reference["spin_speed"]], [1], [5.0])
    assert host.told[-1] == ("logStatusWarning", "one: spin_speed is held over a step: its derivative has no effect")
