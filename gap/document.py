"""What a diagnosis says: the contents of ``diagnosis.json`` (schema rigtwin.diagnosis/1)."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, TypeAdapter, ValidationError

from rigtwin.parsing import parse_json
from rigtwin.scratch import replacing

SCHEMA = "rigtwin.diagnosis/1"
FILE_NAME = "diagnosis.json"

# A number that may not be known: null in the file, nan here.
Number = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]

Verdict = Literal["no_gap", "cause", "ambiguous", "unknown", "not_enough_data"]
Regime = Literal["linear", "amplitude_dependent", "measurement_chain", "spin_dependent"]
LocationKind = Literal[
    "node", "position", "bearings", "disks", "joints", "shaft", "sensor", "exciter", "rigid_support", "raster"
]


@dataclass(frozen=True)
class Estimate:
    """A number with its standard error."""

    value: float
    std: Number = math.nan
    unit: str = "1"


@dataclass(frozen=True)
class Location:
    """Where an effect sits."""

    kind: LocationKind
    node: int | None = None
    x_m: float | None = None


@dataclass(frozen=True)
class Cause:
    """One candidate: one effect, or a pair, with what the data make of it."""

    effects: tuple[str, ...]
    location: Location  # of the first effect
    probability: Number
    parameters: dict[str, Estimate]  # by name; of a pair "<effect>.<name>"
    k_b: Estimate | None  # None: no run on bearings
    log_evidence: Number = math.nan
    ess: float | None = None  # effective sample size of the evidence, where it was sampled
    log_evidence_error: float | None = None  # its standard error by the same draws
    locations: tuple[Location, ...] = ()  # of every effect
    places: dict[str, float] = field(default_factory=dict)  # "<effect>.<place>": node or position
    at_prior_edge: tuple[str, ...] = ()  # parameters at the end of their prior range
    place_probability: float = 1.0  # of these places, where these effects are the cause
    other_places: tuple[tuple[Location, ...], ...] = ()  # of every effect, where they may be as well; best first


@dataclass(frozen=True)
class Band:
    """A stretch of frequency with at most one resonance."""

    f_lo: float  # Hz
    f_hi: float  # Hz
    mode: int | None  # from 1; None: no resonance inside
    share: float  # of the gap


@dataclass(frozen=True)
class NodeShare:
    """A node's share of the gap."""

    node: int
    share: float


@dataclass(frozen=True)
class JointStiffness:
    """Dynamic stiffness that, put in at one place, would explain the gap line by line."""

    node: int
    support: str
    frequency_hz: tuple[float, ...]
    real: tuple[float, ...]  # N/m
    imag: tuple[float, ...]  # N/m
    explained: float  # share of the gap's variance that it explains over all sensors
    order: str  # what it looks like: "stiffness", "mass", "viscous", ... in words


@dataclass(frozen=True)
class BearingStiffness:
    """Dynamic stiffness of each bearing and what it stands on, as one run tells it line by line, beside the models'."""

    run: str
    frequency_hz: tuple[float, ...]  # lines that tell it
    real: tuple[float, ...]  # N/m
    imag: tuple[float, ...]  # N/m
    std: tuple[float, ...]  # N/m, of real and imaginary part
    nominal_real: tuple[float, ...]  # N/m, recalibrated nominal model
    nominal_imag: tuple[float, ...]
    corrected_real: tuple[float, ...] = ()  # N/m, with the effect; empty: none, or no linear one
    corrected_imag: tuple[float, ...] = ()


@dataclass(frozen=True)
class Where:
    """Where the gap lies. Shares sum to 1."""

    bands: tuple[Band, ...] = ()
    supports: dict[str, float] = field(default_factory=dict)
    nodes: tuple[NodeShare, ...] = ()
    regime: Regime = "linear"
    levels: dict[str, float] = field(default_factory=dict)  # force level [N] as text -> share
    joint: JointStiffness | None = None
    bearings: BearingStiffness | None = None  # None: no run tells it, or the gap is named elsewhere
    remark: str = ""


# What the nominal model believes of the damping: keys of ``nominal``, fields of ``sim.campaign.NominalBelief``.
DAMPING = ("shaft_damping_ratio", "bearing_damping_Ns_per_m")


@dataclass(frozen=True)
class NextTest:
    """The measurement that would tell more."""

    words: str
    run: dict[str, Any] = field(default_factory=dict)  # settings of a [[run]]


class DocumentError(ValueError):
    """A text is no diagnosis; the message says what is wrong, and where."""


def explainable(before: float, after: float, floor: float) -> float:
    """Share of a gap above the floor that goes away; nan where there is none.

    >>> explainable(before=0.5, after=0.11, floor=0.1)
    0.975
    """
    return (before - after) / (before - floor) if before > floor else float("nan")


@dataclass(frozen=True)
class Shrink:
    """How far the gap shrinks on data that were held out."""

    held_out: str
    before: Number  # NRMSE of the recalibrated nominal model
    after: Number  # with the effect
    floor: Number  # noise alone
    shrink: Number  # 1 - after / before
    explainable: Number  # (before - after) / (before - floor)
    ci90: tuple[Number, Number]  # of what it explains of noise-free data with another node driven; nan: not known
    verified_by: Literal["fmu", "rig", "model"]
    after_model: float | None = None  # the same after-figure by the fitting model
    without_effect: float | None = None  # NRMSE with gains and tolerances strained in its place


@dataclass(frozen=True)
class Finding:
    """One finding of the measurement audit."""

    check: str  # raster, noise, sign, delay, reciprocity, repeatability, saturation, missing_lines, ...
    severity: Literal["ok", "note", "warning", "error"]
    words: str  # one sentence: what was found and what to do
    run: str = ""  # name of the run, empty: the campaign
    value: float | None = None
    limit: float | None = None


@dataclass(frozen=True)
class Calibrated:
    """A number that is known only within a tolerance, before and after the data.

    The standard error of what is positive is its value times that of its logarithm.
    """

    name: str
    words: str  # what it is
    prior: Estimate
    posterior: Estimate
    learned: bool = False  # nobody states it: the prior is a usual value


@dataclass(frozen=True)
class Calibration:
    """What a fit takes for sensors, for what the workshop knows within tolerances, and for what a test repeats."""

    sensor_gain: dict[str, float] = field(default_factory=dict)  # factor, by channel
    tolerance: dict[str, float] = field(default_factory=dict)  # logarithm of a factor, by name
    numbers: tuple[Calibrated, ...] = ()  # what the workshop knows within tolerances, with errors
    gains: tuple[Calibrated, ...] = ()  # of sensors and runs
    repeatability: tuple[Calibrated, ...] = ()  # standard deviations from run to run


@dataclass(frozen=True)
class FittedJoint:
    """The law of an unknown mechanism at one node: the effect ``measured_joint``."""

    node: int
    at_exciter: bool  # whether it goes with the exciter, because every run drives this node
    parameters: dict[str, Estimate]
    k_b: Estimate | None  # None: no run on bearings
    nodes: tuple[NodeShare, ...]  # probability of the nodes whose laws were fitted
    frequency_hz: tuple[float, ...]  # of its dynamic stiffness over the band of the runs
    real: tuple[float, ...]  # N/m
    imag: tuple[float, ...]  # N/m
    shrink: Shrink  # of the gap on data that were held out
    control: Number  # gap after a black box of as many free numbers or more, on the same data
    calibration: Calibration = field(default_factory=Calibration)  # as a diagnosis has it, of this fit


@dataclass(frozen=True)
class Diagnosis:
    """Everything that stands in ``diagnosis.json``."""

    title: str
    rig: str
    verdict: Verdict
    sentence: str  # the verdict in a sentence
    nominal: dict[str, Any]  # {"k_b": Estimate or None, "gap": float, "gap_dB": float, ...}
    where: Where
    causes: tuple[Cause, ...] = ()
    equivalent: tuple[Cause, ...] = ()
    next_test: NextTest | None = None
    shrink: Shrink | None = None
    audit: tuple[Finding, ...] = ()
    excluded: tuple[str, ...] = ()
    unknown_score: float | None = None  # from 0 (a known effect is adequate) to 1
    calibration: Calibration = Calibration()  # of the model with what is named, else of the nominal one
    timing_s: dict[str, float] = field(default_factory=dict)
    measured_joint: FittedJoint | None = None  # where the verdict is "unknown" and enough sensors tell a place

    def to_json(self) -> str:
        """The file's text; numbers that are not finite become null."""
        return json.dumps({"schema": SCHEMA, **_plain(self)}, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Diagnosis:
        """A diagnosis from the file's text; what a file by hand may leave out is empty. Raises DocumentError."""
        try:
            document = parse_json(text)
        except ValueError as error:
            raise DocumentError(f"{error}; diagnose again") from error
        return cls.from_document(document)

    @classmethod
    def from_document(cls, document: Any) -> Diagnosis:
        """The same from the file's JSON types."""
        schema = document.get("schema") if isinstance(document, Mapping) else None
        if schema != SCHEMA:
            raise DocumentError(f"schema is {schema!r}, not {SCHEMA!r}; give a {FILE_NAME} of rigtwin diagnose")
        blank = {"title": "", "rig": "", "sentence": "", "where": {}}
        if "causes" not in document:
            raise DocumentError("causes is missing; the file is damaged, diagnose again")
        whole = {**blank, **document}
        if isinstance(whole.get("causes"), list):
            whole["causes"] = [_located(cause) for cause in whole["causes"]]
        try:
            diagnosis = _adapter(cls).validate_python(whole)
            k_b = diagnosis.nominal.get("k_b")
            nominal = {**diagnosis.nominal, "k_b": k_b and _adapter(Estimate).validate_python(k_b)}
            if "calibration" in nominal:
                nominal["calibration"] = _adapter(Calibration).validate_python(nominal["calibration"])
        except ValidationError as error:
            raise DocumentError(f"{_first_fault(error)}; the file is damaged, diagnose again") from error
        return dataclasses.replace(diagnosis, nominal=nominal)

    @property
    def names_a_cause(self) -> bool:
        """Whether the corrected model is another than the nominal one."""
        return self.verdict in ("cause", "ambiguous") and bool(self.causes)

    @property
    def correction(self) -> FittedJoint | None:
        """The law at a node that corrects the model under an unknown cause."""
        return self.measured_joint if self.verdict == "unknown" else None

    def save(self, folder: Path) -> Path:
        """Write ``diagnosis.json`` into a folder and return its path."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / FILE_NAME
        with replacing(path) as beside:
            beside.write_text(self.to_json(), encoding="utf-8")
        return path


@lru_cache
def _adapter(kind: type) -> TypeAdapter:
    return TypeAdapter(kind)


def _located(cause: Any) -> Any:
    """A cause of a file by hand may say its places alone."""
    places = isinstance(cause, dict) and "places" in cause
    return {"location": {"kind": "node"}, "probability": None, **cause} if places else cause


def _first_fault(error: ValidationError) -> str:
    """The first thing that is wrong, with its place: 'cause 1 k_b is missing'."""
    fault = error.errors(include_url=False)[0]
    place = " ".join(str(part + 1) if isinstance(part, int) else str(part) for part in fault["loc"])
    where = place.replace("causes ", "cause ") or "the document"
    if fault["type"] == "missing":
        return f"{where} is missing"
    return f"{where} is {str(fault['input'])[:40]!r}: {fault['msg'][:1].lower()}{fault['msg'][1:]}"


def _plain(value: Any) -> Any:
    """JSON types of nested dataclasses; fields that are None in a location are left out."""
    if isinstance(value, Location):
        return {key: _plain(v) for key, v in vars(value).items() if v is not None}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): _plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
