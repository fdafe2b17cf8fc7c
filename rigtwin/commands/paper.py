"""The paper's measured numbers, taken as real input: which k_b do they give, and do they agree?"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.api.estimates import Ratio, features_of_campaign_peaks
from rigtwin.api.fmus import Estimator
from rigtwin.errors import UserError
from rigtwin.estimator.features import Features
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import Estimate
from rigtwin.estimator.validity import objections
from rigtwin.pages.figures import two_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.wording import interval, percent, stiffness

# From here on the paper's Table 1 means the rigid support.
_RIGID = 1e14


@dataclass(frozen=True)
class Reading:
    """A stiffness and its one-sigma interval [N/m]."""

    source: str
    k_b: float
    low: float
    high: float


@dataclass(frozen=True)
class Peak:
    """A measured resonance beside the model's [Hz]."""

    name: str
    measured: float
    std: float
    model: float

    @property
    def difference(self) -> float:
        """Relative, measured against model."""
        return self.measured / self.model - 1


@dataclass(frozen=True)
class PaperReading:
    """What the paper's numbers say."""

    features: Features
    readings: tuple[Reading, ...]  # from the first shift, from the second, from the estimator with all
    estimate: Estimate
    objections: tuple[str, ...]
    printed_k_b: float  # the paper's own answer [N/m]
    shifts_at_printed: tuple[float, float]  # our model's shifts there [Hz]
    undamped_ratio: float  # A1/A0 at the estimate without bearing damping
    bearing_damping: float  # what gives the measured ratio there [N s/m]
    peaks: tuple[Peak, ...]

    @property
    def agree(self) -> bool:
        """Whether one k_b lies in all three one-sigma intervals."""
        return max(r.low for r in self.readings) <= min(r.high for r in self.readings)

    def deviations_at_printed(self) -> tuple[float, float]:
        """Measured less predicted shift at the paper's k_b, in standard errors."""
        f = self.features
        first, second = self.shifts_at_printed
        return (f.delta_f1 - first) / f.delta_f1_std, (f.delta_f2 - second) / f.delta_f2_std

    def record(self) -> dict[str, Any]:
        """For a machine."""
        peaks = [{**asdict(peak), "difference": peak.difference} for peak in self.peaks]
        return {**asdict(self), "peaks": peaks, "agree": self.agree, "deviations": self.deviations_at_printed()}


def paper_folder() -> Path:
    """The shipped campaign: inside the installed package, or among the examples of a checkout."""
    spec = find_spec("rigtwin.paper_campaign")
    places = () if spec is None else spec.submodule_search_locations or ()
    for folder in map(Path, places):
        if folder.is_dir():
            return folder
    raise UserError("the paper's campaign is missing; install rigtwin again, or run from a complete checkout")


def printed() -> dict[str, Any]:
    """What the paper prints beside its peaks."""
    return tomllib.loads((paper_folder() / "paper.toml").read_text(encoding="utf-8"))


def read_paper(ask: Estimator, card: dict[str, Any]) -> PaperReading:
    """Ask the finite-element model and the estimator what the measured numbers mean."""
    campaign, conclusion = load_campaign(paper_folder()), printed()["conclusion"]
    ratio = Ratio(conclusion["amplitude_ratio"], conclusion["amplitude_ratio_std"])
    features = features_of_campaign_peaks(campaign, ratio)
    structure = assemble(load_rig(campaign.rig))
    finder = StiffnessFinder(structure)
    estimate = ask(features)
    readings = (
        _from_shift(finder, 1, features.delta_f1, features.delta_f1_std),
        _from_shift(finder, 2, features.delta_f2, features.delta_f2_std),
        Reading(
            "estimator FMU, all three", estimate.k_b, estimate.k_b - estimate.k_b_std, estimate.k_b + estimate.k_b_std
        ),
    )
    measured = {p.support: (p.frequencies_hz, p.std_hz) for p in campaign.peaks}
    first, second = finder.shifts(conclusion["k_b"]).tolist()
    return PaperReading(
        features=features,
        readings=readings,
        estimate=estimate,
        objections=tuple(objections(features, estimate, card)),
        printed_k_b=conclusion["k_b"],
        shifts_at_printed=(first, second),
        undamped_ratio=finder.amplitude_ratio(estimate.k_b, 0.0),
        bearing_damping=finder.bearing_damping_for_ratio(estimate.k_b, ratio.value),
        peaks=tuple(_peaks(structure, estimate.k_b, measured)),
    )


def _from_shift(finder: StiffnessFinder, mode: int, shift: float, std: float) -> Reading:
    """A larger shift means a softer bearing."""
    k_b, low, high = (finder.from_shift(mode, value) for value in (shift, shift + std, shift - std))
    return Reading(f"Δf{mode} alone, finite elements", k_b, low, high)


def _peaks(structure: Structure, k_b: float, measured: dict[str, tuple[FloatArray, FloatArray]]) -> Iterator[Peak]:
    for support, (frequencies, stds) in measured.items():
        model = two_frequencies_hz(structure, Condition(k_b=k_b, rigid_support=support == "rigid"))
        for mode in (0, 1):
            name = f"f{mode + 1}, {support} support"
            yield Peak(name, float(frequencies[mode]), float(stds[mode]), float(model[mode]))


def verdict(paper: PaperReading) -> list[str]:
    """The reading in plain sentences."""
    return [_which_stiffness(paper), _the_printed_one(paper), _the_ratio(paper), _the_peaks(paper)]


def _which_stiffness(paper: PaperReading) -> str:
    f, estimate = paper.features, paper.estimate
    first, second, fused = (f"{stiffness(reading.k_b)} MN/m" for reading in paper.readings)
    trusted = f"with a 90 % interval of {interval(estimate.k_b_low, estimate.k_b_high)} MN/m"
    return (
        f"The first shift alone, {f.delta_f1:g} ± {f.delta_f1_std:.1f} Hz, gives {first}; the second alone, "
        f"{f.delta_f2:g} ± {f.delta_f2_std:.1f} Hz, gives {second}; the estimator, given both and the ratio "
        f"{f.amplitude_ratio:g}, gives {fused} {trusted if estimate.valid else 'and calls it not valid'}. "
        f"{'One' if paper.agree else 'No one'} stiffness fits all three."
    )


def _the_printed_one(paper: PaperReading) -> str:
    first, second = paper.shifts_at_printed
    one, two = paper.deviations_at_printed()
    stiff_or_soft = "stiff" if paper.estimate.k_b < paper.printed_k_b else "soft"
    return (
        f"The paper says {paper.printed_k_b / 1e6:g} MN/m. There our model has shifts of {first:.1f} and {second:.1f} "
        f"Hz, so the measured ones are {one:+.1f} and {two:+.1f} standard errors away: on our model that bearing is "
        f"too {stiff_or_soft} for the measured shifts."
    )


def _the_ratio(paper: PaperReading) -> str:
    return (
        f"The amplitude ratio needs damping in the bearings: without any it would be {paper.undamped_ratio:.1f} at "
        f"this stiffness, and {paper.bearing_damping:.0f} N s/m in each bearing bring it down to "
        f"{paper.features.amplitude_ratio:g}. It says more about damping than about stiffness."
    )


def _the_peaks(paper: PaperReading) -> str:
    rigid_1, rigid_2, bearing_1, bearing_2 = map(_against, paper.peaks)
    return (
        "The peaks themselves lie below the model even on rigid supports, where no bearing can be blamed: "
        f"{rigid_1} and {rigid_2}; on the bearings {bearing_1} and {bearing_2}. Shifts cancel part of such an error, "
        "not all of it; what is left is in none of these intervals."
    )


def _against(peak: Peak) -> str:
    return f"{peak.measured:g} Hz against {peak.model:.1f} Hz ({percent(peak.difference)})"


@dataclass(frozen=True)
class TableRow:
    """A printed natural frequency beside ours [Hz]."""

    k_b: float
    printed: tuple[float, float]
    ours: tuple[float, float]


def table_1(structure: Structure) -> list[TableRow]:
    """Natural frequencies, the paper's program against ours."""
    table = printed()["table1"]
    rows = []
    for k_b, f1, f2 in zip(table["k_b"], table["f1"], table["f2"], strict=True):
        rigid = k_b >= _RIGID
        ours = two_frequencies_hz(structure, Condition(rigid_support=rigid, **({} if rigid else {"k_b": k_b})))
        rows.append(TableRow(k_b, (f1, f2), (float(ours[0]), float(ours[1]))))
    return rows


def table_2_largest_difference(structure: Structure) -> float:
    """Largest relative difference of the 24 printed frequency shifts."""
    table, finder = printed()["table2"], StiffnessFinder(structure)
    ours = np.array([finder.shifts(k_b) for k_b in table["k_b"]])  # (12, 2)
    theirs = np.array([table["delta_f1"], table["delta_f2"]]).T
    return float(np.max(np.abs(ours / theirs - 1)))
