"""FMUs: found or built, opened, asked."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from fmpy.model_description import ModelDescription

from rigtwin.api.rigs import as_rig
from rigtwin.errors import UserError, existing, for_users
from rigtwin.estimator.features import FEATURE_NAMES, Features
from rigtwin.estimator.runtime import OUTPUT_NAMES, Estimate, StiffnessEstimator
from rigtwin.fmu_src.build import (
    ESTIMATOR_FMU,
    LISTENERS,
    SHIPPED_RIG,
    BuildError,
    build_estimator_fmu,
    build_listener_fmu,
    build_native,
    build_native_listener_fmu,
    build_native_rotor_fmu,
    build_rotor_fmu,
    is_shipped,
)
from rigtwin.fmu_src.built_here import is_built_here
from rigtwin.fmu_src.compiling import CompileError, can_compile, targets_named, this_machine
from rigtwin.fmu_src.tracker_variables import TRACKER_NETWORK
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.scratch import scratch_folder
from rigtwin.sim.archive import DESCRIPTION, ArchiveError, FmuError, read_member
from rigtwin.sim.session import FmuSession

logger = logging.getLogger(__name__)

Estimator = Callable[[Features], Estimate]


class Host(Protocol):
    """Runs a function that opens an FMU; ``progress`` is the function's last argument where it is given."""

    def __call__(
        self, function: Callable[..., Any], *arguments: Any, progress: Callable[[int], None] | None = None
    ) -> Any: ...


def build_rotor(rig: Rig, folder: Path, **options: Any) -> Path:
    """Build RotorRig.fmu; a rig that cannot be built is the user's error unless it is the shipped one."""
    return _built(build_rotor_fmu, rig, folder, options)


def build_rotor_for_the_rig(rig: Rig, folder: Path, **options: Any) -> Path:
    """The same as the virtual rig wants it: compiled where there is a compiler, else pythonfmu's."""
    if not can_compile():
        return build_rotor(rig, folder, **options)
    try:
        return _built(build_native_rotor_fmu, rig, folder, {"targets": [this_machine()], **options})
    except CompileError as error:
        logger.warning("%s; the virtual rig goes on with the slower FMU that runs on Python", error)
        return build_rotor(rig, folder, **options)


def _built(build: Callable[..., Path], rig: Rig, folder: Path, options: dict[str, Any]) -> Path:
    try:
        return build(rig, folder, **options)
    except (BuildError, ValueError) as error:
        if is_shipped(rig):
            raise
        raise UserError(f"rig {rig.name}: no FMU can be built of it: {error}") from error


@for_users
def build_fmu(
    rig: Rig | str | Path = SHIPPED_RIG,
    folder: str | Path = "dist",
    *,
    native: bool = False,
    array_output: bool = False,
    k_b_input: bool = False,
    targets: Sequence[str] = (),
) -> list[Path]:
    """Build RotorRig.fmu of a rig, and StiffnessEstimator.fmu where a network knows the rig.

    Parameters
    ----------
    rig : a rig, its file or its name
    folder : where the FMUs go; made where it is missing
    native : build them once more without Python inside, in ``fmi2`` and ``fmi3`` below the folder; needs a C compiler
        or the package ziglang
    array_output : with ``native``: the FMI 3.0 rotor has all accelerations as one array, too
    k_b_input : k_b is an input of the rotor, which other FMUs can be connected to, and no parameter
    targets : with ``native``: platforms, such as "here" or "x86_64-windows"; default all that can be compiled for

    Returns
    -------
    paths of the FMUs, that of the rotor first

    Raises
    ------
    UserError : the rig cannot be read or built, or there is no compiler

    >>> import rigtwin, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in rigtwin.build_fmu("cantilever", folder)]
    ['RotorRig.fmu']
    """
    check_native(native, array_output, targets)
    rig, folder = as_rig(rig), Path(folder)
    built = [build_rotor(rig, folder, k_b_input=k_b_input)]
    if is_shipped(rig):
        built.append(build_estimator_fmu(folder))
    if native:
        built += build_compiled(rig, folder, array_output=array_output, k_b_input=k_b_input, targets=targets)
    return built


def check_native(native: bool, array_output: bool, targets: Sequence[str]) -> None:
    """Raises UserError for what only FMUs without Python inside can have, where none are built."""
    if array_output and not native:
        raise UserError("--array-output: only the FMI 3.0 FMU of --native can have an array; add --native")
    if targets and not native:
        raise UserError("--target: the FMUs on Python run on every platform; add --native")
    try:
        targets_named(targets)
    except CompileError as error:
        raise UserError(f"--target: {error}") from error


def build_compiled(
    rig: Rig, folder: Path, *, array_output: bool, k_b_input: bool = False, targets: Sequence[str] = ()
) -> list[Path]:
    """The FMUs without Python inside. Raises UserError where they cannot be compiled."""
    try:
        chosen = targets_named(targets) if targets else None
        known = is_shipped(rig)
        return list(
            build_native(rig, folder, estimator=known, array_output=array_output, k_b_input=k_b_input, targets=chosen)
        )
    except CompileError as error:
        raise UserError(str(error)) from error
    except ModuleNotFoundError as error:
        raise _without(error) from error


def build_listeners(
    names: Sequence[str],
    rig: Rig,
    folder: Path,
    nodes: Sequence[int],
    *,
    native: Sequence[str] | None,
    network: Path | None = None,
) -> list[Path]:
    """StiffnessTracker.fmu and GapMonitor.fmu, those that are named, which read these nodes, default the driven one.

    With ``native`` it is built without Python inside, too, for FMI 2.0 and 3.0: for these platforms, or for all where
    there are none. ``network`` is the tracker's, default the shipped one where it knows the rig. Raises UserError where
    it cannot be built.
    """
    try:
        which = [each for each in LISTENERS if each.name in names]
        built = [build_listener_fmu(each, rig, folder, nodes, network) for each in which]
        chosen = targets_named(native) if native else None
        for fmi in ("2.0", "3.0") if native is not None else ():
            beside = folder / f"fmi{fmi[0]}"
            how = {"network": network, "fmi": fmi, "targets": chosen}
            built += [build_native_listener_fmu(each, rig, beside, nodes, **how) for each in which]
    except (BuildError, CompileError) as error:
        raise UserError(str(error)) from error
    except ModuleNotFoundError as error:
        raise _without(error) from error
    return built


def _without(error: ModuleNotFoundError) -> UserError:
    return UserError(f"the network cannot be turned into C without the package {error.name}: pip install onnx")


@contextmanager
def rotor_fmu(source: str | Rig, **options: Any) -> Iterator[Path]:
    """RotorRig.fmu: the file itself, or built of a rig, with these options, for as long as the block runs."""
    if isinstance(source, str) and source.lower().endswith(".fmu"):
        yield existing(Path(source))
        return
    rig = as_rig(source)
    with scratch_folder("rig_") as folder:
        yield build_rotor_for_the_rig(rig, folder, **options)


def manifest(fmu: Path) -> dict[str, Any]:
    """What rigtwin wrote into an FMU when it built it; empty for other tools' FMUs.

    Raises UserError where the file is no FMU at all.
    """
    try:
        if read_member(existing(fmu), DESCRIPTION) is None:
            raise UserError(f"{fmu}: not an FMU, it holds no {DESCRIPTION}")
    except ArchiveError as error:
        raise UserError(f"{fmu}: not an FMU ({error.why})") from error
    try:
        facts = json.loads(read_member(fmu, "resources/manifest.json") or "{}")
    except (ValueError, RecursionError):  # another tool's
        return {}
    return facts if isinstance(facts, dict) else {}


@contextmanager
def host_of(fmu: Path, *, trust: bool) -> Iterator[Host]:
    """Where functions run that open an FMU: here if this installation has built it, else in a process of its own.

    Parameters
    ----------
    trust : whether the user lets an FMU run that was built elsewhere

    Raises
    ------
    UserError : the FMU is another's and not trusted, or it ends the process that runs it
    """
    if is_built_here(existing(fmu)) or (not trust and _is_built_alike(fmu)):
        yield _here
        return
    if not trust:
        raise UserError(
            f"{fmu}: this installation has not built it, and an FMU is a program that runs with all your rights; "
            "if you trust where it comes from, add --trust"
        )
    from rigtwin.workers import WorkerDiedError, report, worker_pool  # the FMUs of most commands are our own

    with worker_pool(1) as pool:

        def apart(function: Callable[..., Any], *arguments: Any, progress: Callable[[int], None] | None = None) -> Any:
            more = (report,) if progress else ()
            try:
                return pool.run(function, *arguments, *more, progress=progress)
            except WorkerDiedError as error:
                raise UserError(f"{fmu}: the FMU crashed the process that ran it ({error.how})") from error

        yield apart


def _is_built_alike(fmu: Path) -> bool:
    """Whether this installation makes the same file of the rig or the network in an FMU.

    So it is with FMUs that were built where the list of them cannot be written, or on another machine by the same
    versions of all packages.
    """
    with scratch_folder("alike_") as folder:
        try:
            return _built_again(fmu, folder).read_bytes() == fmu.read_bytes()
        except Exception:  # whatever is in there, it is none of ours
            return False


def _built_again(fmu: Path, folder: Path) -> Path:
    """The FMU that this installation makes of the rig or the network in another. Raises whatever is wrong with it."""
    names = ("rig.json", "estimator.onnx", "reduced.npz", TRACKER_NETWORK)
    rig, network, reduced, tracker = (read_member(fmu, f"resources/{name}") for name in names)
    if rig and reduced:
        described = read_member(fmu, DESCRIPTION) or b""
        listener = next(each for each in LISTENERS if f'modelName="{each.name}"'.encode() in described)
        known = folder / TRACKER_NETWORK if tracker else None
        if known:
            known.write_bytes(tracker or b"")
        nodes = manifest(fmu)["facts"]["nodes"]
        return build_listener_fmu(listener, Rig.model_validate_json(rig), folder, nodes, known)
    if rig:
        return build_rotor_fmu(Rig.model_validate_json(rig), folder)
    (folder / "network.onnx").write_bytes(network or b"")
    return build_estimator_fmu(folder, folder / "network.onnx")


def _here(function: Callable[..., Any], *arguments: Any, progress: Callable[[int], None] | None = None) -> Any:
    return function(*arguments, progress) if progress else function(*arguments)


@contextmanager
def open_estimator(path: Path | None = None, *, trust: bool = False) -> Iterator[tuple[Estimator, dict[str, Any]]]:
    """An estimator to be asked, and its model card.

    Parameters
    ----------
    path : StiffnessEstimator.fmu or an ONNX file of ``rigtwin train``; default the shipped network
    trust : see ``host_of``
    """
    if path is None or path.suffix.lower() != ".fmu":
        network = _network(existing(path), path) if path else StiffnessEstimator()
        yield lambda features: network.estimate(features.as_array()), network.card
        return
    card = fmu_card(path)
    with host_of(path, trust=trust) as run:
        yield lambda features: run(_ask_once, path, features), card


def _ask_once(fmu: Path, features: Features) -> Estimate:
    with FmuSession(fmu) as session:
        return ask(session, features)


def ask(session: FmuSession, features: Features) -> Estimate:
    """What an open StiffnessEstimator FMU says."""
    session.start(dict(zip(FEATURE_NAMES, features.as_array().tolist(), strict=True)))
    k_b, std, low, high, valid = session.get(OUTPUT_NAMES)
    return Estimate(k_b, std, low, high, bool(valid))


def fmu_card(fmu: Path) -> dict[str, Any]:
    """Model card of the network in StiffnessEstimator.fmu. Raises UserError for other FMUs."""
    manifest(fmu)
    content = read_member(fmu, "resources/estimator.onnx")
    if content is None:
        raise UserError(f"{fmu}: not a {ESTIMATOR_FMU}, it holds no network")
    with scratch_folder("network_") as folder:
        model = folder / "estimator.onnx"
        model.write_bytes(content)
        return _network(model, fmu).card


def _network(path: Path, named: Path) -> StiffnessEstimator:
    """The network in a file. Raises UserError with the file's name as the user knows it."""
    try:
        network = StiffnessEstimator(path)
        network.card  # noqa: B018 - a network without a card is not ours
    except Exception as error:  # onnxruntime has no common base class
        raise UserError(f"{named}: holds no network of rigtwin train ({str(error).partition(chr(10))[0]})") from error
    return network


def estimator_for(rotor: Path, given: Path | None, folder: Path) -> Path:
    """The estimator FMU that goes with a rotor FMU.

    In this order: the one given, the one beside the rotor FMU or in dist/ that was trained for its
    rig, one built into ``folder`` when the rig is the shipped one. Raises UserError.
    """
    rig = manifest(rotor).get("rig", SHIPPED_RIG)
    if given:
        return given
    for candidate in (rotor.with_name(ESTIMATOR_FMU), Path("dist") / ESTIMATOR_FMU):
        if candidate.is_file() and trained_rig(fmu_card(candidate)) == rig:
            return candidate
    if rig == SHIPPED_RIG:
        return build_estimator_fmu(folder)
    raise UserError(
        f"{rotor} is of the rig {rig}, and no estimator trained for it lies beside it; "
        "give one with --estimator, or train one: rigtwin train --rig RIG.toml"
    )


def trained_rig(card: dict[str, Any]) -> str:
    """Name of the rig a network was trained for."""
    return card.get("rig", SHIPPED_RIG)


def excitation_node(description: ModelDescription) -> int:
    """The FMU's own excitation node. Raises FmuError where it has none."""
    for variable in description.modelVariables:
        if variable.name == "excitation_node":
            return int(variable.start or 1)
    raise FmuError(f"{description.modelName} is not a RotorRig FMU: it has no excitation_node")
