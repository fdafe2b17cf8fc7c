"""Universal file format: datasets 151 (header), 164 (units) and one dataset 58 for each function.

A file written here holds, for each channel, its response (function type 4), then its standard error and its
harmonics (function type 0, "general", so that other software does not take them for responses), all binary and in
double precision: the text form keeps six digits of an uneven frequency axis, 0.5 mHz at 300 Hz. Node and direction
stand in record 6 (+Y = 2, +Z = 3), the exciter's as the reference. The ID lines say the rest::

    1  RESPONSE node2 | STANDARD ERROR node2 | HARMONIC 3 node2
    2  the run's name
    3  NONE, or of these two what holds: control=response roving=exciter
    4  rigtwin support=rigid quantity=accelerance sweep=up
    5  force_amplitude_N=1.0 spin_rpm=0.0

A second sensor of a node is called node2b. FORCE holds the force of each line, SWEPT LINES all frequencies of a sweep
of which only some have responses. Where the exciter roved, responses and references are exchanged (``roving``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError, Plane, Quantity, Run
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import RunSettings, check_settings, stored_settings

MARK = "rigtwin"
RESPONSE, STANDARD_ERROR, HARMONIC = "RESPONSE", "STANDARD ERROR", "HARMONIC"
FORCE, SWEPT, COHERENCE = "FORCE", "SWEPT LINES", "COHERENCE"
_OWN_ID1 = re.compile(rf"({RESPONSE}|{STANDARD_ERROR}|{FORCE}|{SWEPT}|{HARMONIC} \d+) node\d+([a-z]?)(_z)?")

DIRECTION: dict[Plane, int] = {"y": 2, "z": 3}
PLANE: dict[int, Plane] = {direction: plane for plane, direction in DIRECTION.items()}

# Specific data types of ordinate numerator and denominator: 8 displacement, 11 velocity, 12 acceleration, 13 force.
DATA_TYPES: dict[Quantity, tuple[int, int]] = {
    "receptance": (8, 13),
    "mobility": (11, 13),
    "accelerance": (12, 13),
    "acceleration": (12, 0),
}
LABELS = {
    18: ("Frequency", "Hz"),
    8: ("Displacement", "m"),
    11: ("Velocity", "m/s"),
    12: ("Acceleration", "m/s^2"),
    13: ("Excitation force", "N"),
    0: ("NONE", "NONE"),
}

# Function types of dataset 58.
GENERAL, FREQUENCY_RESPONSE, COHERENCE_TYPE, SPECTRUM = 0, 4, 6, 12
FREQUENCY_AXIS = (0, 1, 18)  # specific data types of an abscissa: unknown, general, frequency
UNSAID = ((0, 0), (0, 13), (12, 0))  # ordinate types of software that leaves them out: an accelerance
SI = 1  # units code of dataset 164


@dataclass(frozen=True)
class _Function:
    """One dataset 58 of interest."""

    kind: str  # RESPONSE, STANDARD_ERROR, FORCE, SWEPT, COHERENCE or "HARMONIC <order>"
    channel: Channel
    reference: tuple[int, Plane | None]  # exciter's node and plane, None where the file does not say it
    frequency_hz: FloatArray  # (n_freq,)
    values: ComplexArray | FloatArray  # (n_freq,) with the signs of both directions, in SI
    dataset: dict[str, Any]


def read(path: Path, given: RunSettings) -> Recording:
    """Read the responses of a universal file, written here or by other software. Raises MeasurementError."""
    functions = _one_reference(path, _functions(path, given), given)
    responses = [f for f in functions if f.kind == RESPONSE]
    _check_lines(path, functions)
    _check_quantities(path, responses, given)
    frequency_hz = responses[0].frequency_hz
    # A spectrum analyser's first line is at 0 Hz, where nothing moves.
    kept = slice(1 if len(frequency_hz) and frequency_hz[0] == 0 else 0, None)
    channels = tuple(f.channel for f in responses)
    harmonics = sorted({int(f.kind.split()[1]) for f in functions if f.kind.startswith(HARMONIC)})

    def errors(kind: str) -> FloatArray | None:
        there = any(f.kind == kind for f in functions)
        return np.real(_columns(path, functions, kind, channels)[kept]) if there else None

    def whole(kind: str) -> FloatArray | None:
        return next((np.real(f.values) for f in functions if f.kind == kind), None)

    return Recording(
        frequency_hz=frequency_hz[kept],
        H=_columns(path, functions, RESPONSE, channels)[kept].astype(complex),
        channels=channels,
        std=errors(STANDARD_ERROR),
        harmonics={n: _columns(path, functions, f"{HARMONIC} {n}", channels)[kept].astype(complex) for n in harmonics},
        magnitude_only=not np.iscomplexobj(responses[0].values),
        settings=_settings(path, responses[0]),
        force_N=whole(FORCE),
        coherence=errors(COHERENCE),
        swept_hz=whole(SWEPT),
    )


def _datasets(path: Path) -> list[dict[str, Any]]:
    """The datasets 58 and 164 in the file's order; others (geometry, headers) are passed over."""
    if not path.read_bytes().rstrip(b" \r\n\x1a").endswith(b"-1"):
        raise MeasurementError(
            f"{path}: the closing line '    -1' is missing; no universal file, or cut off: export it again"
        )
    try:
        file = pyuff.UFF(str(path))
        wanted = [int(n) for n in np.flatnonzero(np.isin(file.get_set_types(), (58, 164)))]
        datasets = file.read_sets(wanted) if wanted else []
    except Exception as error:  # pyuff raises nothing narrower
        raise MeasurementError(f"{path}: cannot be read as a universal file ({error}); export it again") from error
    return datasets if isinstance(datasets, list) else [datasets]


def _functions(path: Path, given: RunSettings) -> list[_Function]:
    """Every function that belongs to a run. Raises MeasurementError when there is none."""
    functions, length, force, seen = [], 1.0, 1.0, []
    for dataset in _datasets(path):
        if dataset["type"] == 164:
            # Factors of the units code SI are 1; files exist that say SI and carry the factors of feet and pounds.
            length, force = (1.0, 1.0) if dataset["units_code"] == SI else (dataset["length"], dataset["force"])
            if not (length > 0 and force > 0):
                raise MeasurementError(f"{path}: unit factors of dataset 164 are {length}, {force}; export it in SI")
            continue
        dataset = _exchanged(dataset, given)
        kind = _kind(dataset, given)
        if kind and abs(dataset["rsp_dir"]) in PLANE and abs(dataset["ref_dir"]) in (0, *PLANE):
            per_force = given.get("quantity", _quantity(dataset)) != "acceleration"
            unit = (force if per_force else 1.0) / length if kind != COHERENCE else 1.0
            functions.append(_function(path, dataset, kind, unit))
        else:
            beside = f" of a force in direction {dataset['ref_dir']}" if dataset["ref_dir"] else ""
            seen.append(f"type {dataset['func_type']} in direction {dataset['rsp_dir']}{beside}")
    if not any(f.kind == RESPONSE for f in functions):
        raise MeasurementError(
            f"{path}: no frequency response (dataset 58, function type 4) in direction 2 (Y) or 3 (Z); "
            f"the file has {', '.join(dict.fromkeys(seen)) or 'no dataset 58'}; give every channel its node and "
            "direction in the measuring software, or write CSV"
        )
    return functions


def _exchanged(dataset: dict[str, Any], given: RunSettings) -> dict[str, Any]:
    """A dataset of a roving exciter by reciprocity: the place of the blow as that of the response, and the reverse."""
    own = {"roving": "exciter"} if _own_kind(dataset) and "roving=exciter" in dataset["id3"].split() else {}
    if {**own, **given}.get("roving") != "exciter":
        return dataset
    pairs = {
        f"{a}_{what}": dataset[f"{b}_{what}"] for a, b in (("rsp", "ref"), ("ref", "rsp")) for what in ("node", "dir")
    }
    return {**dataset, **pairs}


def _own_kind(dataset: dict[str, Any]) -> str | None:
    """What a dataset written here says it is, None for one of other software."""
    own = _OWN_ID1.fullmatch(dataset["id1"]) if dataset["id4"].startswith(f"{MARK} ") else None
    return own[1] if own else None


def _kind(dataset: dict[str, Any], given: RunSettings) -> str | None:
    if own := _own_kind(dataset):
        return own
    spectrum = (
        given.get("quantity") == "acceleration"
        and dataset["func_type"] == SPECTRUM
        and dataset["ordinate_spec_data_type"] in (0, DATA_TYPES["acceleration"][0])
    )
    if dataset["func_type"] == COHERENCE_TYPE and "averages" in given:
        return COHERENCE
    return RESPONSE if spectrum or dataset["func_type"] == FREQUENCY_RESPONSE else None


def _function(path: Path, dataset: dict[str, Any], kind: str, factor: float) -> _Function:
    """One dataset 58 in SI and along the positive axes; ``factor`` turns the file's units into SI."""
    own = _OWN_ID1.fullmatch(dataset["id1"]) if _own_kind(dataset) else None
    channel = Channel(dataset["rsp_node"], PLANE[abs(dataset["rsp_dir"])], own[2] if own else "")
    points, values, frequency_hz = dataset["num_pts"], dataset["data"], dataset["x"]
    if dataset["abscissa_spec_data_type"] not in FREQUENCY_AXIS:
        raise MeasurementError(
            f"{path}: the abscissa of {channel} has type {dataset['abscissa_spec_data_type']}, which is no frequency "
            "(18); export responses over frequency"
        )
    if len(values) < points:
        raise MeasurementError(f"{path}: {channel} has {len(values)} of {points} values: damaged, export it again")
    if np.iscomplexobj(values) and (dataset["rsp_dir"] < 0) != (dataset["ref_dir"] < 0):
        factor = -factor
    return _Function(
        kind=kind,
        channel=channel,
        reference=(dataset["ref_node"], PLANE.get(abs(dataset["ref_dir"]))),
        frequency_hz=np.asarray(frequency_hz[:points], dtype=float),
        values=values[:points] if factor == 1 else values[:points] * factor,
        dataset=dataset,
    )


def _one_reference(path: Path, functions: list[_Function], given: RunSettings) -> list[_Function]:
    """The functions of one exciter place; where a file holds several, the campaign's settings choose."""
    references = dict.fromkeys(f.reference for f in functions)
    if len(references) == 1:
        return functions
    node, plane = given.get("excitation_node"), given.get("excitation_plane")
    chosen = [r for r in references if node in (None, r[0]) and (r[1] is None or plane in (None, r[1]))]
    if len(chosen) != 1:
        places = ", ".join(f"node {r[0]} {r[1] or ''}".strip() for r in references)
        raise MeasurementError(
            f"{path}: holds responses to forces at {places}; choose one with excitation_node and excitation_plane"
        )
    return [f for f in functions if f.reference == chosen[0]]


def _check_lines(path: Path, functions: list[_Function]) -> None:
    first = next(f for f in functions if f.kind == RESPONSE)
    for function in functions:
        if function.kind == SWEPT:
            continue
        if not np.array_equal(function.frequency_hz, first.frequency_hz):
            raise MeasurementError(
                f"{path}: {first.channel} and {function.channel} have different frequency lines; "
                "export all channels of a run on the same lines"
            )
        if function.kind == RESPONSE and np.iscomplexobj(function.values) != np.iscomplexobj(first.values):
            raise MeasurementError(
                f"{path}: {first.channel} and {function.channel}: one is complex, the other a magnitude; "
                "put them in run files of their own"
            )


def _check_quantities(path: Path, responses: list[_Function], given: RunSettings) -> None:
    first = responses[0]
    for response in responses:
        types = _ordinate(response.dataset)
        if types != _ordinate(first.dataset):
            raise MeasurementError(
                f"{path}: {first.channel} and {response.channel} hold different quantities (ordinate types "
                f"{_ordinate(first.dataset)} and {types}); export all channels of a run in one"
            )
    known = "quantity" in given or _own_kind(first.dataset) or _quantity(first.dataset)
    if not known and _ordinate(first.dataset) not in UNSAID:
        raise MeasurementError(
            f"{path}: ordinate types {_ordinate(first.dataset)} are none of {', '.join(DATA_TYPES)}; say the run's "
            "quantity in campaign.toml"
        )


def _columns(path: Path, functions: list[_Function], kind: str, channels: tuple[Channel, ...]) -> np.ndarray:
    """(n_freq, n_channels) values of one kind."""
    by_channel = {f.channel: f.values for f in functions if f.kind == kind}
    if len(by_channel) != sum(f.kind == kind for f in functions) or set(by_channel) != set(channels):
        held = ", ".join(str(f.channel) for f in functions if f.kind == kind)
        raise MeasurementError(f"{path}: {kind} is there for {held}; it must be there once for every channel")
    return np.column_stack([by_channel[channel] for channel in channels])


def _settings(path: Path, response: _Function) -> RunSettings:
    """What a file says of the run: the exciter's place, the quantity, and the ID lines of a file written here."""
    node, plane = response.reference
    quantity = _quantity(response.dataset)
    found: dict[str, Any] = {"excitation_node": node, "excitation_plane": plane, "quantity": quantity}
    if _own_kind(response.dataset):
        words = " ".join(str(response.dataset[line]) for line in ("id3", "id4", "id5")).split()
        found |= {word.partition("=")[0]: word.partition("=")[2] for word in words if "=" in word}
    # Other software leaves fields it does not use at 0.
    return check_settings({key: value for key, value in found.items() if value not in (None, 0)}, path)


def _quantity(dataset: dict[str, Any]) -> Quantity | None:
    """Quantity from the data types, None where they name none."""
    types = _ordinate(dataset)
    return next((quantity for quantity, known in DATA_TYPES.items() if known == types and known[1]), None)


def _ordinate(dataset: dict[str, Any]) -> tuple[int, int]:
    """Specific data types of numerator and denominator."""
    return int(dataset["ordinate_spec_data_type"]), int(dataset["orddenom_spec_data_type"])


def write(run: Run, path: Path) -> None:
    """Write a universal file, every number in double precision.

    The datasets 58 are written here and not by pyuff, whose binary form has a wrong byte count in its
    first record, turns NaN into 0, cannot hold a single line and leaves the file open.
    """
    pyuff.UFF(str(path)).write_sets([_header(run), _units()], mode="add")
    with path.open("ab") as file:
        for block in _blocks(run):
            file.write(block)


def _header(run: Run) -> dict[str, Any]:
    return pyuff.prepare_151(model_name=_one_line(run.name), description="stepped-sine run", db_app=MARK, program=MARK)


def _units() -> dict[str, Any]:
    return pyuff.prepare_164(
        units_code=SI, units_description="SI", temp_mode=1, length=1.0, force=1.0, temp=1.0, temp_offset=273.15
    )


def _blocks(run: Run) -> Iterator[bytes]:
    """One dataset 58 for each function of a run."""
    for i, channel in enumerate(run.channels):
        responses = [(RESPONSE, FREQUENCY_RESPONSE, run.H)]
        responses += [(f"{HARMONIC} {order}", GENERAL, h) for order, h in sorted(run.harmonics.items())]
        for kind, function_type, values in responses:
            parts = [values[:, i].real] if run.magnitude_only else [values[:, i].real, values[:, i].imag]
            yield _dataset_58(run, channel, kind, function_type, parts)
        if run.std is not None:
            yield _dataset_58(run, channel, STANDARD_ERROR, GENERAL, [run.std[:, i]])
    for kind, values in ((FORCE, run.force_N), (SWEPT, run.swept_hz)):
        if values is not None:
            yield _dataset_58(run, run.channels[0], kind, GENERAL, [values])


def _dataset_58(run: Run, channel: Channel, kind: str, function_type: int, parts: list[FloatArray]) -> bytes:
    """A binary dataset 58, abscissa uneven; ``parts`` are real values, or real and imaginary part, (n_freq,) each."""
    x = parts[0] if kind == SWEPT else run.frequency_hz
    body = np.column_stack([x, *parts]).astype("<f8").tobytes()  # x1 re1 im1 x2 re2 im2 …
    records = [*_id_lines(run, channel, kind), *_number_records(run, channel, function_type, np.shape(parts))]
    # Record 1: little endian (1), IEEE 754 (2), lines of text below, bytes below these.
    first = f"{58:6d}b{1:6d}{2:6d}{len(records):12d}{len(body):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    text = "".join(f"{line:<80}\n" for line in (first, *records))
    return f"{-1:6d}\n{text}".encode("ascii") + body + f"{-1:6d}\n".encode("ascii")


def _id_lines(run: Run, channel: Channel, kind: str) -> list[str]:
    """The five ID lines, records 1 to 5 of the text form."""
    settings = stored_settings(run)

    def words(*keys: str) -> str:
        return " ".join(f"{key}={settings[key]}" for key in keys if key in settings)

    force, spin = settings["force_amplitude_N"], settings["spin_rpm"]
    return [
        f"{kind} {channel}",
        _one_line(run.name),
        words("control", "roving") or "NONE",
        f"{MARK} {words('support', 'quantity', 'sweep')}",
        f"force_amplitude_N={force} spin_rpm={spin}",
    ]


def _number_records(run: Run, channel: Channel, function_type: int, shape: tuple[int, ...]) -> list[str]:
    """Records 6 to 11 of the text form: places and directions, data form, and what each axis is.

    ``shape`` is that of the values, (1, n_lines) of real and (2, n_lines) of complex ones.
    """
    response = f"{'NONE':>10}{channel.node:10d}{DIRECTION[channel.plane]:4d}"
    reference = f"{'NONE':>10}{run.excitation_node:10d}{DIRECTION[run.excitation_plane]:4d}"
    if run.roving == "exciter":
        response, reference = reference, response
    double_precision = {1: 4, 2: 6}[shape[0]]
    uneven = 0
    return [
        f"{function_type:5d}{0:10d}{0:5d}{0:10d} {response} {reference}",
        f"{double_precision:10d}{shape[1]:10d}{uneven:10d}{0:13.5e}{0:13.5e}{0:13.5e}",
        *(
            f"{data_type:10d}{0:5d}{0:5d}{0:5d} {LABELS[data_type][0]:<20} {LABELS[data_type][1]:<20}"
            for data_type in (18, *DATA_TYPES[run.quantity], 0)
        ),
    ]


def _one_line(text: str) -> str:
    """Text that fits an ID line: 80 printable ASCII characters, NONE where there are none."""
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in text).strip()[:80] or "NONE"
