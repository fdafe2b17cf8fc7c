"""FMUs and their host share one Python: none may take another's modules, folders or end.

Every test runs hosts of its own in child processes, in another working directory.
"""

from __future__ import annotations

import importlib.util
import itertools
import os

import pytest

from tests.fmu.child import ChildDiedError, in_child


def read_all(fmus, *, steps=20):
    """Readings of FMUs that live and step side by side, loaded in this order."""
    from contextlib import ExitStack

    from rigtwin.sim.session import FmuSession

    with ExitStack() as stack:
        sessions = [stack.enter_context(FmuSession(fmu)) for fmu in fmus]
        for session in sessions:
            session.start({"force_amplitude": 1.0} if "force_amplitude" in session.variables else {})
        readings = []
        for _ in range(steps):
            for session in sessions:
                session.step(1e-3)
        for session in sessions:
            outputs = ["node_2.acceleration_y", "node_5.acceleration_y"]
            readings.append(session.get(outputs if outputs[0] in session.variables else ["k_b", "k_b_std", "valid"]))
    return readings


@pytest.fixture(scope="module")
def alone(rotor_fmu, larger_disks_fmu, estimator_fmu):
    """Readings of each FMU in a process that has no other."""
    return {fmu: in_child(read_all, [fmu])[0] for fmu in (rotor_fmu, larger_disks_fmu, estimator_fmu)}


def test_the_two_rigs_do_read_differently(alone, rotor_fmu, larger_disks_fmu):
    """Without this, the tests below could not tell one rig's code or data from the other's."""
    assert abs(alone[rotor_fmu][0] / alone[larger_disks_fmu][0] - 1) > 0.01


@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["rotor first", "estimator first"])
def test_rotor_and_estimator_in_one_process_each_read_as_alone(alone, rotor_fmu, estimator_fmu, order):
    fmus = [(rotor_fmu, estimator_fmu)[k] for k in order]
    assert in_child(read_all, fmus) == [alone[fmu] for fmu in fmus]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["this rig first", "other rig first"])
def test_two_rigs_in_one_process_each_read_as_alone(alone, rotor_fmu, larger_disks_fmu, order):
    """Both are called RotorRig.fmu and hold a class RotorRig."""
    fmus = [(rotor_fmu, larger_disks_fmu)[k] for k in order]
    assert in_child(read_all, fmus) == [alone[fmu] for fmu in fmus]


def test_many_instances_of_all_fmus_in_one_process_each_read_as_alone(alone):
    fmus = [fmu for pair in itertools.permutations(alone, 2) for fmu in pair]
    assert in_child(read_all, fmus) == [alone[fmu] for fmu in fmus]


def side_by_side(fmu, stiffnesses):
    """Readings of instances with different k_b, stepped in turns."""
    from contextlib import ExitStack

    from rigtwin.sim.session import FmuSession

    with ExitStack() as stack:
        sessions = [stack.enter_context(FmuSession(fmu)) for _ in stiffnesses]
        for session, k_b in zip(sessions, stiffnesses, strict=True):
            session.start({"k_b": k_b, "force_amplitude": 1.0})
        for _ in range(50):
            for session in sessions:
                session.step(1e-3)
        return [session.get(["node_2.acceleration_y"]) for session in sessions]


def test_instances_of_one_fmu_keep_their_parameters_apart(rotor_fmu):
    stiffnesses = [1e6, 1e7, 1e8]
    together = in_child(side_by_side, rotor_fmu, stiffnesses)
    assert together == [in_child(side_by_side, rotor_fmu, [k_b])[0] for k_b in stiffnesses]
    assert len({reading for (reading,) in together}) == 3


def one_after_the_other(fmus):
    """Readings of FMUs of which each is freed, its folder deleted, before the next is loaded."""
    from rigtwin.sim.session import FmuSession

    readings = []
    for fmu in fmus:
        with FmuSession(fmu) as session:
            session.start({"force_amplitude": 1.0})
            for _ in range(20):
                session.step(1e-3)
            readings.append(session.get(["node_2.acceleration_y", "node_5.acceleration_y"]))
    return readings


def test_an_fmu_loads_again_after_its_folder_has_vanished(alone, rotor_fmu, larger_disks_fmu):
    fmus = [rotor_fmu, larger_disks_fmu, rotor_fmu, rotor_fmu, larger_disks_fmu]
    assert in_child(one_after_the_other, fmus) == [alone[fmu] for fmu in fmus]


def with_sabotaged_host(fmus, names):
    """Readings where the host's own modules of these names raise at the first touch."""
    import sys
    from types import ModuleType

    import rigtwin.sim.session

    class Sabotaged(ModuleType):
        def __getattr__(self, attribute):
            raise AssertionError(f"the host's {self.__name__}.{attribute} was used")

    for name in names:
        sys.modules[name] = Sabotaged(name)
    assert rigtwin.sim.session.FmuSession  # imported before, and used by read_all
    return read_all(fmus)


def test_a_hosts_own_modules_of_the_same_names_are_not_used(alone, rotor_fmu, estimator_fmu):
    packages = {
        "rigtwin": ("rotor", "fmu_src", "estimator"),
        "rigtwin.rotor": ("simulator", "stepper", "structure", "system"),
        "rigtwin.fmu_src": ("slave", "variables", "rotor_slave", "estimator_slave"),
        "rigtwin.estimator": ("runtime",),
        "pythonfmu": ("fmi2slave", "variables", "enums", "default_experiment", "logmsg", "_version"),
    }
    names = [*packages, *(f"{package}.{module}" for package, modules in packages.items() for module in modules)]
    names += ["rotor_slave", "estimator_slave", "slave", "variables"]
    fmus = [rotor_fmu, estimator_fmu]
    assert in_child(with_sabotaged_host, fmus, names, using=[read_all]) == [alone[fmu] for fmu in fmus]


def after_the_hosts_own_imports(fmus):
    """Readings in a host that has imported the real packages first, and has broken them since."""
    import importlib

    import rigtwin.sim.session

    def broken(*arguments, **options):
        raise AssertionError("the host's own package was used")

    assert rigtwin.sim.session.FmuSession
    for module, name in (
        ("rigtwin.rotor.time.stepper", "expm"),
        ("rigtwin.rotor.model.system", "eigh"),
        ("rigtwin.rotor.time.simulator", "RotorSimulator"),
        ("rigtwin.estimator.runtime", "StiffnessEstimator"),
        ("rigtwin.fmu_src.slave", "TableSlave"),
        ("pythonfmu.fmi2slave", "Fmi2Slave"),
    ):
        setattr(importlib.import_module(module), name, broken)
    return read_all(fmus)


def test_a_host_that_imported_and_broke_the_real_packages_gets_the_fmus_own(alone, rotor_fmu, estimator_fmu):
    fmus = [rotor_fmu, estimator_fmu]
    assert in_child(after_the_hosts_own_imports, fmus, using=[read_all]) == [alone[fmu] for fmu in fmus]


HOST_MODULES = [
    "pythonfmu",
    "pythonfmu.fmi2slave",
    "rigtwin.rotor",
    "rigtwin.rotor.time.simulator",
    "rigtwin.fmu_src.slave",
    "rigtwin.estimator.runtime",
]


def import_afterwards(fmus, still_open, names):
    """Where the host's imports come from while FMUs are loaded, or after they were freed."""
    import importlib
    import sys
    from contextlib import ExitStack

    from rigtwin.sim.session import FmuSession

    packages = {name.split(".")[0] for name in names}
    with ExitStack() as stack:
        for fmu in fmus:
            session = FmuSession(fmu)
            if still_open:
                stack.enter_context(session)
            else:
                session.close()
        for name in [n for n in sys.modules if n.split(".")[0] in packages]:
            del sys.modules[name]
        return [importlib.import_module(name).__file__ for name in names]


@pytest.mark.parametrize("still_open", [True, False], ids=["loaded", "freed"])
def test_the_hosts_imports_after_an_fmu_come_from_its_own_environment(rotor_fmu, estimator_fmu, still_open):
    found = in_child(import_afterwards, [rotor_fmu, estimator_fmu], still_open, HOST_MODULES)
    assert found == [importlib.util.find_spec(name).origin for name in HOST_MODULES]


def in_a_bare_host(fmu, allowed, values, outputs):
    """Readings where only the standard library and the allowed packages can be imported.

    fmpy drives the FMU, but is taken away, with all else, before the FMU is instantiated.
    """
    import sys
    from importlib.abc import MetaPathFinder
    from pathlib import Path

    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    folder = extract(fmu, unzipdir=str(Path("unpacked").resolve()))
    description = read_model_description(folder)
    numbers = {v.name: v.valueReference for v in description.modelVariables}
    own = {path.stem for path in Path(folder, "resources").iterdir()}
    known = set(sys.stdlib_module_names) | set(allowed) | own

    class OnlyKnown(MetaPathFinder):
        def find_spec(self, name, path=None, target=None):
            if name.split(".")[0] not in known and not name.startswith("_sysconfigdata"):  # of the platform
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)
            return None

    for name in [n for n in sys.modules if n.split(".")[0] not in known | {"__main__"}]:
        del sys.modules[name]
    sys.meta_path.insert(0, OnlyKnown())
    slave = FMU2Slave(
        guid=description.guid, unzipDirectory=folder, modelIdentifier=description.modelName, instanceName="bare"
    )

    def log(environment, instance, status, category, message):
        print(message.decode(), file=sys.stderr)

    logger = fmi2CallbackLoggerTYPE(log)
    callbacks = fmi2CallbackFunctions(
        logger=logger, allocateMemory=defaultCallbacks.allocateMemory, freeMemory=defaultCallbacks.freeMemory
    )
    slave.instantiate(callbacks=callbacks, loggingOn=True)
    slave.setupExperiment(startTime=0.0)
    slave.setReal([numbers[name] for name in values], list(values.values()))
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    for step in range(20):
        slave.doStep(1e-3 * step, 1e-3)
    readings = slave.getReal([numbers[name] for name in outputs])
    slave.terminate()
    slave.freeInstance()
    loaded = {name.split(".")[0] for name in sys.modules} - set(sys.stdlib_module_names) - own - {"__main__"}
    return list(readings), sorted(loaded)


def test_the_rotor_needs_only_numpy_and_scipy(alone, rotor_fmu):
    outputs = ["node_2.acceleration_y", "node_5.acceleration_y"]
    readings, loaded = in_child(in_a_bare_host, rotor_fmu, ["numpy", "scipy"], {"force_amplitude": 1.0}, outputs)
    assert readings == alone[rotor_fmu]
    assert {"numpy", "scipy"} <= set(loaded)


def test_the_estimator_needs_only_numpy_and_onnxruntime(alone, estimator_fmu):
    readings, loaded = in_child(in_a_bare_host, estimator_fmu, ["numpy", "onnxruntime"], {}, ["k_b", "k_b_std"])
    assert readings == alone[estimator_fmu][:2]
    assert {"numpy", "onnxruntime"} <= set(loaded)


def test_the_bare_host_does_refuse_what_is_not_allowed(rotor_fmu):
    """Negative control: without scipy the rotor cannot be instantiated."""
    with pytest.raises(ChildDiedError, match="scipy"):
        in_child(in_a_bare_host, rotor_fmu, ["numpy"], {}, [])


# -- folders -------------------------------------------------------------------------------------


def test_it_runs_from_a_folder_with_spaces(alone, rotor_fmu, tmp_path):
    folder = tmp_path / "a folder with spaces"
    folder.mkdir()
    assert in_child(read_all, [rotor_fmu], TMPDIR=str(folder)) == [alone[rotor_fmu]]


def test_the_fmu_file_itself_may_lie_anywhere(alone, rotor_fmu, tmp_path):
    anywhere = tmp_path / "Prüfstand + 50 % #1"
    anywhere.mkdir()
    copy = anywhere / "Rotor é.fmu"
    copy.write_bytes(rotor_fmu.read_bytes())
    assert in_child(read_all, [copy]) == [alone[rotor_fmu]]


@pytest.mark.parametrize("name", ["a+b", "Prüfstand", "100%"])
def test_a_temporary_folder_that_would_crash_the_loader_is_refused_with_one_message(rotor_fmu, tmp_path, name):
    def refusal(fmu):
        from rigtwin.sim.session import FmuError, FmuSession

        try:
            FmuSession(fmu)
        except FmuError as error:
            return str(error)
        return None

    folder = tmp_path / name
    folder.mkdir()
    message = in_child(refusal, rotor_fmu, TMPDIR=str(folder))
    assert message.startswith(f"the folder for temporary files, {folder}{os.sep}")
    assert message.endswith("set TMPDIR")
    assert list(folder.iterdir()) == []


def leave_nothing_behind(fmus):
    """Files left in the temporary folder and in the working directory after FMUs were used."""
    import os
    import tempfile

    from rigtwin.sim.session import FmuSession

    for fmu in fmus:
        with FmuSession(fmu) as session:
            session.start()
            session.step(1e-3)
    return sorted(os.listdir(tempfile.gettempdir())), os.listdir(".")


def test_nothing_is_left_on_disk(rotor_fmu, estimator_fmu, tmp_path):
    """Importing onnxruntime leaves a file .ses in the temporary folder, with or without an FMU."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    assert in_child(leave_nothing_behind, [rotor_fmu], TMPDIR=str(temporary)) == [[], []]
    left, beside = in_child(leave_nothing_behind, [estimator_fmu], TMPDIR=str(temporary))
    assert set(left) <= {".ses"}
    assert beside == []


# -- the end of the host -------------------------------------------------------------------------


def watch_the_end(fmu, instances):
    """At exit, print how often each loaded glue library was told to end its interpreter state."""
    import atexit
    import ctypes
    import json
    from contextlib import ExitStack

    from rigtwin.sim.session import FmuSession

    calls = []

    class Library(ctypes.CDLL):
        def __getattr__(self, name):
            function = super().__getattr__(name)
            if name != "finalizePythonInterpreter":
                return function

            def end():
                calls.append(self._name)
                return function()

            return end

    atexit.register(lambda: print(json.dumps(calls)))  # runs after what the FMU registers
    ctypes.CDLL = Library
    with ExitStack() as stack:
        for _ in range(instances):
            session = stack.enter_context(FmuSession(fmu))
            for _ in range(3):
                session.start()
                session.step(1e-3)
    return None


def test_every_glue_library_ends_its_interpreter_state_once_before_the_process_exits(rotor_fmu):
    """pythonfmu's library frees that state twice at exit, which aborts one host in some dozens.

    Its own finaliser, called while Python is still there, leaves both destructors nothing to free
    (seen with valgrind: an invalid read in ``finalizePythonInterpreter`` without, none with).
    """
    ended = in_child(watch_the_end, rotor_fmu, 2)
    assert len(ended) == len(set(ended)) == 2
    assert all(library.endswith("RotorRig.so") for library in ended)
