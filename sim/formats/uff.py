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

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError, Plane, Quantity, Run
from rigtwin.sim.formats.csv_header import PLACE, channel_of
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import RunSettings, check_settings, stored_settings
from rigtwin.sim.formats.uff_datasets import DatasetError, End, Function, Units, read_datasets
from rigtwin.sim.formats.units import FORCE as FORCE_UNITS
from rigtwin.sim.formats.units import FREQUENCY, MOTION, factor_of, motion_and_force

logger = logging.getLogger(__name__)

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
_SI_UNITS = Units(SI, 1.0, 1.0)


@dataclass(frozen=True)
class _Function:
    """One dataset 58 of interest."""

    kind: str  # RESPONSE, STANDARD_ERROR, FORCE, SWEPT, COHERENCE or "HARMONIC <order>"
    channel: Channel
    reference: tuple[int, Plane | None]  # exciter's node and plane, None where the file does not say it
    frequency_hz: FloatArray  # (n_freq,)
    values: ComplexArray | FloatArray  # (n_freq,) with the signs of both directions, in SI
    dataset: Function


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


def _datasets(path: Path) -> Iterator[Function | Units]:
    """The datasets 58 and 164 in the file's order; others (geometry, headers) are passed over."""
    content = path.read_bytes()
    if not content.rstrip(b" \r\n\x1a").endswith(b"-1"):
        raise MeasurementError(
            f"{path}: the closing line '    -1' is missing; no universal file, or cut off: export it again"
        )
    try:
        yield from read_datasets(content)
    except DatasetError as error:
        raise MeasurementError(f"{path}: cannot be read as a universal file ({error}); export it again") from error


def _functions(path: Path, given: RunSettings) -> list[_Function]:
    """Every function that belongs to a run. Raises MeasurementError when there is none."""
    functions, units, seen, number = [], _SI_UNITS, [], 0
    labels: dict[str, None] = {}
    channel_map = _ChannelMap(path, given)
    for dataset in _datasets(path):
        if isinstance(dataset, Units):
            # Factors of the units code SI are 1; files exist that say SI and carry the factors of feet and pounds.
            units = _SI_UNITS if dataset.code == SI else dataset
            if not (units.length > 0 and units.force > 0):
                raise MeasurementError(
                    f"{path}: unit factors of dataset 164 are {units.length}, {units.force}; export it in SI"
                )
            continue
        kind = _kind(dataset, given)
        number += kind == RESPONSE
        dataset = _exchanged(channel_map.placed(dataset, number), given)
        if kind and abs(dataset.response.direction) in PLANE and abs(dataset.reference.direction) in (0, *PLANE):
            per_force = given.get("quantity", _quantity(dataset)) != "acceleration"
            unit = 1.0
            if kind != COHERENCE and "unit" not in given:
                unit = _motion_unit(dataset, units, labels) * (_force_unit(dataset, units, labels) if per_force else 1)
            per_hertz = 1.0 if "frequency_unit" in given else _of_label(dataset.abscissa.unit, FREQUENCY, labels)
            functions.append(_function(path, dataset, kind, unit, per_hertz))
        else:
            seen.append(_words(dataset))
    if labels:
        logger.warning("%s: %s", path, "; ".join(labels))
    channel_map.check([f for f in functions if f.kind == RESPONSE])
    if not any(f.kind == RESPONSE for f in functions):
        raise MeasurementError(
            f"{path}: no frequency response (dataset 58, function type 4) in direction 2 (Y) or 3 (Z); "
            f"the file has {', '.join(dict.fromkeys(seen)) or 'no dataset 58'}; give every channel its node and "
            "direction in the measuring software or with the run's key channels, or write CSV"
        )
    return functions


def _words(dataset: Function) -> str:
    """What a dataset that is passed over holds."""
    name, beside = dataset.response.name, dataset.reference.direction
    named = f" named {name!r}" if name and name != "NONE" else ""
    force = f" of a force in direction {beside}" if beside else ""
    return f"type {dataset.function_type} in direction {dataset.response.direction}{named}{force}"


class _ChannelMap:
    """Where ends of functions are that have no number of a node: by the run's key ``channels`` or by their names."""

    def __init__(self, path: Path, given: RunSettings):
        self._path, self._channels = path, given.get("channels", {})
        self._used: set[str] = set()
        self._names: dict[str, None] = {}

    def placed(self, dataset: Function, number: int) -> Function:
        """A dataset with its ends in place; ``number`` counts the responses, and is a name of those without one."""
        if _own_kind(dataset):
            return dataset
        response = self._place(dataset.response, dataset.response.name, str(number))
        return replace(dataset, response=response, reference=self._place(dataset.reference, dataset.reference.name))

    def _place(self, end: End, *names: str) -> End:
        known = next((name for name in names if name in self._channels), None)
        if known is not None:
            self._used.add(known)
            try:
                sign, channel = channel_of(self._channels[known])
            except ValueError as error:
                raise MeasurementError(f"{self._path}: channels: {error}") from error
            return replace(end, node=channel.node, direction=sign * DIRECTION[channel.plane])
        if (end.node == 0 or end.direction == 0) and (named := PLACE.fullmatch(end.name)):
            direction = "XYZ".index(named[2].upper()) + 1
            return replace(end, node=int(named[1]), direction=direction if named[3] == "+" else -direction)
        self._names |= dict.fromkeys(name for name in names if name and name != "NONE")
        return end

    def check(self, responses: list[_Function]) -> None:
        """Refuse names that the file does not have, and responses at no node."""
        there = ", ".join(map(repr, self._names))
        if unknown := [name for name in self._channels if name not in self._used]:
            raise MeasurementError(
                f"{self._path}: channels: {unknown[0]!r} is in the file neither as a name nor as the number of a "
                f"response; it has {there or 'no other'}"
            )
        if any(f.channel.node == 0 for f in responses):
            name = next(f.dataset.response.name for f in responses if f.channel.node == 0)
            first = "1" if name in ("", "NONE") else name
            raise MeasurementError(
                f"{self._path}: responses have no number of a node; the file calls them {there}. Say in the run's "
                f'table of campaign.toml where they are, for example channels = {{"{first}" = "node2"}}'
            )


def _motion_unit(dataset: Function, units: Units, labels: dict[str, None]) -> float:
    """Factor to SI of what moves: of a label that names another unit than SI, or else of dataset 164."""
    told = _of_label(motion_and_force(dataset.numerator.unit)[0], MOTION, labels)
    return 1 / units.length if told == 1 else told


def _force_unit(dataset: Function, units: Units, labels: dict[str, None]) -> float:
    """The same of one over the force."""
    told = _of_label(dataset.denominator.unit, FORCE_UNITS, labels)
    return units.force if told == 1 else 1 / told


def _of_label(label: str, known: dict[str, float], labels: dict[str, None]) -> float:
    """Factor to SI of a label; 1 where it is not known. What is done stands in ``labels``, each once."""
    factor = factor_of(label, known)
    if factor is None:
        labels[f"the unit {label!r} is not known and taken for that of SI"] = None
    elif factor != 1:
        labels[f"values in {label} are turned into SI, times {factor:.6g}"] = None
    return factor or 1.0


def _exchanged(dataset: Function, given: RunSettings) -> Function:
    """A dataset of a roving exciter by reciprocity: the place of the blow as that of the response, and the reverse."""
    own = {"roving": "exciter"} if _own_kind(dataset) and "roving=exciter" in dataset.ids[2].split() else {}
    if {**own, **given}.get("roving") != "exciter":
        return dataset
    return replace(dataset, response=dataset.reference, reference=dataset.response)


def _own_kind(dataset: Function) -> str | None:
    """What a dataset written here says it is, None for one of other software."""
    own = _OWN_ID1.fullmatch(dataset.ids[0]) if dataset.ids[3].startswith(f"{MARK} ") else None
    return own[1] if own else None


def _kind(dataset: Function, given: RunSettings) -> str | None:
    if own := _own_kind(dataset):
        return own
    spectrum = (
        given.get("quantity") == "acceleration"
        and dataset.function_type == SPECTRUM
        and dataset.numerator.data_type in (0, DATA_TYPES["acceleration"][0])
    )
    if dataset.function_type == COHERENCE_TYPE and "averages" in given:
        return COHERENCE
    return RESPONSE if spectrum or dataset.function_type == FREQUENCY_RESPONSE else None


def _function(path: Path, dataset: Function, kind: str, factor: float, per_hertz: float) -> _Function:
    """One dataset 58 in SI and along the positive axes; the factors turn the file's units into SI."""
    own = _OWN_ID1.fullmatch(dataset.ids[0]) if _own_kind(dataset) else None
    channel = Channel(dataset.response.node, PLANE[abs(dataset.response.direction)], own[2] if own else "")
    points, values, axis = dataset.n_values, dataset.values, dataset.abscissa
    if axis.data_type not in FREQUENCY_AXIS:
        raise MeasurementError(
            f"{path}: the abscissa of {channel} has type {axis.data_type}, which is no frequency "
            "(18); export responses over frequency"
        )
    if len(values) < points:
        raise MeasurementError(f"{path}: {channel} has {len(values)} of {points} values: damaged, export it again")
    if np.iscomplexobj(values) and (dataset.response.direction < 0) != (dataset.reference.direction < 0):
        factor = -factor
    return _Function(
        kind=kind,
        channel=channel,
        reference=(dataset.reference.node, PLANE.get(abs(dataset.reference.direction))),
        frequency_hz=dataset.x[:points] * per_hertz,
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
        words = " ".join(response.dataset.ids[2:]).split()
        found |= {word.partition("=")[0]: word.partition("=")[2] for word in words if "=" in word}
    # Other software leaves fields it does not use at 0.
    return check_settings({key: value for key, value in found.items() if value not in (None, 0)}, path)


def _quantity(dataset: Function) -> Quantity | None:
    """Quantity from the data types, None where they name none."""
    types = _ordinate(dataset)
    return next((quantity for quantity, known in DATA_TYPES.items() if known == types and known[1]), None)


def _ordinate(dataset: Function) -> tuple[int, int]:
    """Specific data types of numerator and denominator."""
    return dataset.numerator.data_type, dataset.denominator.data_type


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
