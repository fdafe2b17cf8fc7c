"""Two campaigns beside each other: which resonances, dampings and amplitudes have changed, and which have not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import erfc

from rigtwin.errors import UserError, for_users
from rigtwin.gap.curves import nrmse
from rigtwin.pages.diagnosis_words import share
from rigtwin.pages.figures import BLUE, INK
from rigtwin.pages.overlay_page import Layer, Overlay, Table, write_overlays
from rigtwin.rotor.model import html
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Campaign, Channel, MeasurementError, NominalBelief, PeakList, Run
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.modal_fit import Mode, try_modes
from rigtwin.wording import with_error

# A comparison calls something significant by chance alone once in so many comparisons.
FALSE_ALARM = 0.05

# Two modes whose frequencies differ by a larger factor are not taken for the same mode, whatever their shapes.
_SAME_MODE = 1.5

# How much a difference of shapes counts against one of frequencies: MAC 0 is like a factor e^0.5.
_SHAPE_WEIGHT = 0.5

# No difference is known better than the arithmetic of a fit knows it: a share of the value.
_ARITHMETIC = 1e-9

# Forces that were measured are of one level where they differ by no more than this factor.
_SAME_LEVEL = 1.1


@dataclass(frozen=True)
class Change:
    """A number in both campaigns, and by how much it has changed, with standard errors."""

    a: float
    a_std: float
    b: float
    b_std: float
    change: float  # b - a of a frequency [Hz], b / a - 1 of a damping or an amplitude
    std: float
    p: float  # probability of a change so large by chance alone
    significant: bool = False  # among all changes of the comparison


@dataclass(frozen=True)
class ModeChange:
    """One mode in both campaigns."""

    run: str  # of A and of B
    support: str
    mode: int  # from 1
    frequency_hz: Change
    damping_ratio: Change | None = None  # None: only a list of resonances is there
    amplitude: Change | None = None  # of the mode alone at its resonance, at the channel that is named
    channel: str = ""


@dataclass(frozen=True)
class RunChange:
    """A pair of runs: the same support, exciter, quantity, level and spin."""

    run: str
    support: str
    gap: float  # of lines and channels that both have: sqrt(sum |H_B - H_A|² / sum |H_A|²), averaged over the channels
    floor: float  # what the standard errors of both runs give; nan where one has none
    largest_at_hz: float  # line with the largest difference
    n_lines: int  # that both have


COMPARISON_HEADER = (
    "run", "support", "mode", "frequency A, Hz", "change, Hz", "damping A, %", "change, %", "amplitude, change, %",
    "significant",
)  # fmt: skip
RUN_HEADER = ("run", "support", "lines in both", "difference", "noise alone", "largest at, Hz")


@dataclass(frozen=True)
class Comparison:
    """What has changed between two campaigns."""

    a: Campaign
    b: Campaign
    modes: tuple[ModeChange, ...]
    runs: tuple[RunChange, ...]
    pairs: tuple[tuple[Run, Run], ...]
    remarks: tuple[str, ...] = ()

    @property
    def significant(self) -> list[ModeChange]:
        """Modes of which something has changed by more than chance."""
        return [mode for mode in self.modes if any(c.significant for c in _changes(mode))]

    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        found, n = self.significant, sum(len(_changes(mode)) for mode in self.modes)
        if not self.modes:
            return "No mode was found in both campaigns; the responses are compared line by line."
        if not found:
            return f"Nothing has changed by more than the errors allow, of {n} numbers of {len(self.modes)} modes."
        first = max(found, key=lambda mode: abs(mode.frequency_hz.change) / mode.frequency_hz.std)
        f = first.frequency_hz
        largest = f"{first.support} support, mode {first.mode}: {_signed(f.change, f.std)} Hz at {f.a:.6g} Hz"
        return f"{len(found)} of {len(self.modes)} modes have changed significantly; the clearest shift is {largest}."

    def rows(self) -> list[tuple[str, ...]]:
        """For a reader, beneath COMPARISON_HEADER."""
        return [_row(mode) for mode in self.modes]

    def run_rows(self) -> list[tuple[str, ...]]:
        """For a reader, beneath RUN_HEADER."""
        return [
            (r.run, r.support, str(r.n_lines), _share(r.gap), _share(r.floor), f"{r.largest_at_hz:.6g}")
            for r in self.runs
        ]

    def record(self) -> dict[str, Any]:
        """For a machine."""
        return {
            "a": self.a.title,
            "b": self.b.title,
            "sentence": self.sentence,
            "false_alarm": FALSE_ALARM,
            "modes": [asdict(mode) for mode in self.modes],
            "runs": [asdict(run) for run in self.runs],
            "remarks": list(self.remarks),
        }

    def save(self, page: str | Path) -> Path:
        """Write the page with tables and responses, and return its path. Raises UserError."""
        return _save(self, Path(page))

    def __str__(self) -> str:
        """The result in a sentence."""
        return self.sentence

    def _repr_html_(self) -> str:
        drawn = [_drawing(a, b) for a, b in self.pairs[:2]]
        tables = html.table(COMPARISON_HEADER, self.rows()) + html.table(RUN_HEADER, self.run_rows())
        return html.paragraph(self.sentence) + "".join(drawn) + tables + "".join(map(html.paragraph, self.remarks))


@for_users
def compare(a: Campaign | str | Path, b: Campaign | str | Path) -> Comparison:
    """What has changed from campaign A to campaign B: resonances, dampings, amplitudes, and responses line by line.

    Runs are paired by support, exciter, quantity, level, direction and spin; modes by frequency and shape
    (``rigtwin.sim.modal_fit``). The standard error of a change holds those of both fits, and the tolerances that the
    campaigns state: ``frequency_drift``, for frequencies and dampings, and ``gain_tolerance``, for amplitudes. What is
    called significant would be so by chance once in 20 comparisons (Holm's step-down test over all changes).

    Parameters
    ----------
    a, b : campaigns as they were loaded, or their folders

    Raises
    ------
    UserError : a campaign cannot be used, or nothing in A has a counterpart in B

    >>> import numpy as np, rigtwin
    >>> lines = np.arange(70.0, 110.0, 0.02)
    >>> def campaign(k_b):
    ...     return rigtwin.Campaign("", "nit-rourkela", (rigtwin.model_response("nit-rourkela", lines, k_b=k_b),))
    >>> found = rigtwin.compare(campaign(5e6), campaign(4.9e6))
    >>> round(found.modes[0].frequency_hz.change, 3), found.modes[0].frequency_hz.significant
    (-0.139, True)
    """
    first, second = (c if isinstance(c, Campaign) else load_campaign(c) for c in (a, b))
    pairs, remarks = _pairs(first, second)
    lists = _lists(first, second)
    if not pairs and not lists:
        raise UserError(
            f"nothing in {_name(first, 'A')} has a counterpart in {_name(second, 'B')}: the same support, exciter, "
            f"quantity, level and spin; A has {_described(first)}; B has {_described(second)}"
        )
    if first.rig != second.rig:
        remarks.append(f"A is of the rig {first.rig}, B of {second.rig}")
    beliefs = first.nominal, second.nominal
    modes: list[ModeChange] = []
    for run_a, run_b in pairs:
        found, said = _mode_changes(run_a, run_b, beliefs)
        modes += found
        remarks += said
    modes += chain.from_iterable(_peak_changes(one, other, beliefs) for one, other in lists)
    runs = [change for one, other in pairs if (change := _run_change(one, other))]
    return Comparison(first, second, tuple(_judged(modes)), tuple(runs), tuple(pairs), tuple(remarks))


def _name(campaign: Campaign, letter: str) -> str:
    return f"campaign {letter} ({campaign.title})" if campaign.title else f"campaign {letter}"


def _described(campaign: Campaign) -> str:
    """Its runs and lists."""
    runs = [f"{run.name} ({run.support}, node {run.excitation_node}, {run.quantity})" for run in campaign.runs]
    lists = [f"a list of resonances ({peaks.support})" for peaks in campaign.peaks]
    return ", ".join([*runs, *lists]) or "nothing"


# -- pairs ---------------------------------------------------------------------------------------------


def _pairs(a: Campaign, b: Campaign) -> tuple[list[tuple[Run, Run]], list[str]]:
    """Runs of the same settings, the first with the first; and a sentence on those that are alone."""
    left = list(b.runs)
    pairs, alone = [], []
    for run in a.runs:
        alike = (each for each in left if _settings(each) == _settings(run) and _same_force(each, run))
        other = next(alike, None)
        if other is None or not set(run.channels) & set(other.channels):
            alone.append(f"{run.name} of A")
            continue
        left.remove(other)
        pairs.append(_on_common_channels(run, other))
    alone += [f"{run.name} of B" for run in left]
    remarks = [f"without a counterpart, and left out: {', '.join(alone)}"] if alone and pairs else []
    return pairs, remarks


def _settings(run: Run) -> tuple[object, ...]:
    """What two runs must have in common to be compared."""
    place = run.excitation_node, run.excitation_plane
    return run.support, place, run.quantity, run.sweep, run.spin_rpm, run.magnitude_only


def _same_force(one: Run, other: Run) -> bool:
    """Whether two runs are of one level; forces that were measured differ a little."""
    a, b = one.force_amplitude_N, other.force_amplitude_N
    if a is None or b is None or (one.force_N is None and other.force_N is None):
        return a == b
    return max(a, b) <= _SAME_LEVEL * min(a, b)


def _on_common_channels(a: Run, b: Run) -> tuple[Run, Run]:
    common = [channel for channel in a.channels if channel in b.channels]
    one, other = (run.with_channels([run.channels.index(channel) for channel in common]) for run in (a, b))
    return one, other


def _lists(a: Campaign, b: Campaign) -> list[tuple[PeakList, PeakList]]:
    return [(one, other) for one in a.peaks for other in b.peaks if one.support == other.support]


# -- modes ---------------------------------------------------------------------------------------------


def _mode_changes(a: Run, b: Run, beliefs: tuple[NominalBelief, NominalBelief]) -> tuple[list[ModeChange], list[str]]:
    """Changes of the modes that both runs show, and what is said of the others."""
    fitted, remarks = [], []
    for run, letter in ((a, "A"), (b, "B")):
        try:
            modes, left_out = try_modes(run)
        except MeasurementError as error:
            return [], [*remarks, f"{letter}: {error}"]
        fitted.append(modes)
        remarks += [f"{letter}: {words}" for words in left_out]
    matched = _matched(*fitted)
    for letter, modes, place in (("A", fitted[0], 0), ("B", fitted[1], 1)):
        lonely = sorted(set(range(len(modes))) - {pair[place] for pair in matched})
        if lonely:
            at = ", ".join(f"{modes[k].frequency_hz:.5g} Hz" for k in lonely)
            remarks.append(f"{(a, b)[place].name}: modes of {letter} without a counterpart: {at}")
    name = a.name if a.name == b.name else f"{a.name} / {b.name}"
    channel = Channel(a.excitation_node, a.excitation_plane)
    channel = channel if channel in a.channels else a.loudest
    place = a.channels.index(channel)
    return [
        ModeChange(
            name,
            a.support,
            i + 1,
            _frequency(fitted[0][i], fitted[1][j], beliefs),
            _damping(fitted[0][i], fitted[1][j], beliefs),
            _amplitude(fitted[0][i], fitted[1][j], place, beliefs),
            str(channel),
        )
        for i, j in matched
    ], remarks


def _matched(a: Sequence[Mode], b: Sequence[Mode]) -> list[tuple[int, int]]:
    """Places of the modes that are the same in both: near in frequency, and alike in shape."""
    distance = np.array([[_distance(one, other) for other in b] for one in a])
    rows, columns = linear_sum_assignment(np.minimum(distance, 1e3))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if np.isfinite(distance[i, j])]


def _distance(a: Mode, b: Mode) -> float:
    """|log of the frequencies' ratio|, and what is missing to the same shape; infinite for what is too far apart."""
    apart = abs(math.log(a.frequency_hz / b.frequency_hz))
    return math.inf if apart > math.log(_SAME_MODE) else apart + _SHAPE_WEIGHT * (1 - _mac(a.residue, b.residue))


def _mac(a: np.ndarray, b: np.ndarray) -> float:
    """Modal assurance criterion |a^H b|² / (a^H a)(b^H b): 1 for the same shape; 1, too, where one channel tells it."""
    size = np.vdot(a, a).real * np.vdot(b, b).real
    return float(abs(np.vdot(a, b)) ** 2 / size) if size > 0 and len(a) > 1 else 1.0


def _frequency(a: Mode, b: Mode, beliefs: tuple[NominalBelief, NominalBelief]) -> Change:
    return _difference((a.frequency_hz, a.frequency_std_hz), (b.frequency_hz, b.frequency_std_hz), _drift(beliefs))


def _damping(a: Mode, b: Mode, beliefs: tuple[NominalBelief, NominalBelief]) -> Change:
    return _ratio((a.damping_ratio, a.damping_ratio_std), (b.damping_ratio, b.damping_ratio_std), _drift(beliefs))


def _amplitude(a: Mode, b: Mode, place: int, beliefs: tuple[NominalBelief, NominalBelief]) -> Change | None:
    one, other = ((float(mode.resonance[place]), float(mode.resonance_std[place])) for mode in (a, b))
    gain = math.hypot(*(belief.gain_tolerance for belief in beliefs))
    return _ratio(one, other, gain) if one[0] > 0 and other[0] > 0 else None


def _drift(beliefs: tuple[NominalBelief, NominalBelief]) -> float:
    """Relative standard deviation from run to run that the campaigns state, of both; what is to be learned is none."""
    return math.hypot(*(belief.frequency_drift or 0.0 for belief in beliefs))


def _difference(a: tuple[float, float], b: tuple[float, float], tolerance: float = 0.0) -> Change:
    """b - a, with a relative tolerance."""
    std = float(np.sqrt(a[1] ** 2 + b[1] ** 2 + (max(tolerance, _ARITHMETIC) * a[0]) ** 2))
    return Change(*a, *b, b[0] - a[0], std, _chance((b[0] - a[0]) / std))


def _ratio(a: tuple[float, float], b: tuple[float, float], tolerance: float) -> Change:
    """b / a - 1, with a relative tolerance."""
    ratio = b[0] / a[0]
    std = ratio * float(np.sqrt((a[1] / a[0]) ** 2 + (b[1] / b[0]) ** 2 + max(tolerance, _ARITHMETIC) ** 2))
    return Change(*a, *b, ratio - 1, std, _chance((ratio - 1) / std))


def _chance(z: float) -> float:
    """Probability that a normal variable is further from zero than so many standard errors."""
    return float(erfc(abs(z) / math.sqrt(2)))


def _peak_changes(a: PeakList, b: PeakList, beliefs: tuple[NominalBelief, NominalBelief]) -> Iterator[ModeChange]:
    """Lists of resonances, the first of one with the first of the other."""
    rows = zip(a.frequencies_hz, a.std_hz, b.frequencies_hz, b.std_hz, strict=False)
    for place, (f_a, std_a, f_b, std_b) in enumerate(rows, start=1):
        change = _difference((float(f_a), float(std_a)), (float(f_b), float(std_b)), _drift(beliefs))
        yield ModeChange("resonance lists", a.support, place, change)


# -- which are significant -------------------------------------------------------------------------------


def _changes(mode: ModeChange) -> list[Change]:
    return [change for change in (mode.frequency_hz, mode.damping_ratio, mode.amplitude) if change]


def _judged(modes: Sequence[ModeChange]) -> Iterator[ModeChange]:
    """The same with what is significant, by Holm's step-down test (Scand. J. Statist. 6, 1979, 65-70)."""
    limit = holm_limit([change.p for mode in modes for change in _changes(mode)])
    for mode in modes:
        judged = [
            change and Change(**(asdict(change) | {"significant": change.p <= limit}))
            for change in (mode.frequency_hz, mode.damping_ratio, mode.amplitude)
        ]
        assert judged[0] is not None
        yield ModeChange(mode.run, mode.support, mode.mode, judged[0], judged[1], judged[2], mode.channel)


def holm_limit(p: Sequence[float], false_alarm: float = FALSE_ALARM) -> float:
    """Largest p that is significant among all; -1 where none is.

    >>> holm_limit([0.5, 0.001, 0.02], false_alarm=0.05)
    0.02
    >>> holm_limit([0.5, 0.04])
    -1.0
    """
    limit = -1.0
    for rank, value in enumerate(sorted(p)):
        if value > false_alarm / (len(p) - rank):
            break
        limit = value
    return limit


# -- line by line ------------------------------------------------------------------------------------------


def _run_change(a: Run, b: Run) -> RunChange | None:
    """The responses on the lines that both runs have; None where they have none."""
    lines, in_a, in_b = np.intersect1d(np.round(a.frequency_hz, 9), np.round(b.frequency_hz, 9), return_indices=True)
    if not len(lines):
        return None
    H_a, H_b = a.H[in_a], b.H[in_b]
    apart: FloatArray = np.linalg.norm(np.nan_to_num(H_b - H_a), axis=1)
    floor = math.nan
    if a.std is not None and b.std is not None:
        floor = nrmse(H_a, H_a + np.hypot(a.std[in_a], b.std[in_b]))
    name = a.name if a.name == b.name else f"{a.name} / {b.name}"
    return RunChange(name, a.support, nrmse(H_a, H_b), floor, float(lines[np.argmax(apart)]), len(lines))


# -- for a reader -----------------------------------------------------------------------------------------


def _row(mode: ModeChange) -> tuple[str, ...]:
    f, zeta, amplitude = mode.frequency_hz, mode.damping_ratio, mode.amplitude
    named = zip(("frequency", "damping", "amplitude"), (f, zeta, amplitude), strict=True)
    found = [name for name, change in named if change and change.significant]
    return (
        mode.run,
        mode.support,
        str(mode.mode),
        with_error(f.a, f.a_std),
        _signed(f.change, f.std),
        with_error(100 * zeta.a, 100 * zeta.a_std) if zeta else "",
        _signed(100 * zeta.change, 100 * zeta.std) if zeta else "",
        _signed(100 * amplitude.change, 100 * amplitude.std) if amplitude else "",
        ", ".join(found) or "no",
    )


def _signed(change: float, std: float) -> str:
    """'+0.14 ± 0.02'."""
    text = with_error(abs(change), std)
    return f"{'−' if change < 0 else '+'}{text}"


def _share(value: float) -> str:
    return share(value) if math.isfinite(value) else ""


def _drawing(a: Run, b: Run) -> str:
    channel = a.loudest
    lines = [
        html.Line(
            run.frequency_hz, np.abs(run.channel(channel.node, channel.plane, channel.label)), label, colour, dash
        )
        for run, label, colour, dash in ((a, "A", "currentColor", "5 4"), (b, "B", BLUE, ""))
    ]
    return html.curves(lines, "frequency, Hz", f"{a.quantity}, {channel}, {a.support}")


@for_users
def _save(found: Comparison, path: Path) -> Path:
    title = f"{found.a.title or 'A'} and {found.b.title or 'B'}"
    modes = Table(
        "Modes",
        COMPARISON_HEADER,
        found.rows(),
        "± is one standard error: of the fits, and of the drift and the gains that the campaigns state. What is called "
        "significant would be so by chance once in 20 such comparisons.",
    )
    runs = Table(
        "Responses, line by line",
        RUN_HEADER,
        found.run_rows(),
        "The difference is the root of the squared difference between A and B on the lines that both have, divided by "
        "A and averaged over the channels. Noise alone is what the standard errors give.",
    )
    overlays = [
        Overlay(
            f"{a.name}, {a.support} support",
            [
                Layer(a, f"A: {found.a.title or a.name}", {"line": {"color": INK, "width": 2, "dash": "dot"}}),
                Layer(b, f"B: {found.b.title or b.name}", {"line": {"color": BLUE, "width": 2}}),
            ],
            f"Force at node {a.excitation_node} along {a.excitation_plane}.",
        )
        for a, b in found.pairs
    ]
    return write_overlays(path, title, found.sentence, found.remarks, [modes, runs], overlays)
