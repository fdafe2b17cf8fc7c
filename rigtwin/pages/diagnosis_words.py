"""What a diagnosis says, in words: for the terminal and for the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rigtwin.estimator.intervals import Z90
from rigtwin.gap.document import Calibrated, Cause, Diagnosis, Estimate, Shrink
from rigtwin.gap.phrases import listed, place, ten_to
from rigtwin.parsing import toml_lines
from rigtwin.rotor.effects import EFFECTS
from rigtwin.wording import interval, number, stiffness_with_error, unit, with_error

VERDICTS = {
    "cause": "Cause found",
    "ambiguous": "More than one cause fits",
    "unknown": "No known effect fits",
    "no_gap": "No gap",
    "not_enough_data": "Not enough data",
}

REGIMES = {
    "linear": "the same at every force level that was measured",
    "amplitude_dependent": "changes with the force level",
    "measurement_chain": "in the measurement chain: the resonances lie where the model has them",
    "spin_dependent": "changes with the spin",
}

VERIFIED = {
    "fmu": "the effect was switched on in RotorRig.fmu and the virtual rig measured the held-out settings again",
    "rig": "the virtual rig measured the held-out settings again, with the effect in its measurement chain",
    "model": "by the fitting model alone; no virtual measurement confirms it",
}

# Why a diagnosis names no cause, where its verdict is one of these.
NO_CAUSE = {
    "no_gap": "No cause is named. The candidates below are ranked among themselves; none of them is needed.",
    "unknown": "No cause is named. The candidates below are ranked among themselves; none of them explains the data.",
    "not_enough_data": "No cause is named. The data do not suffice to tell the candidates apart.",
}


def finite(value: float | None) -> bool:
    """Whether there is a number."""
    return value is not None and math.isfinite(value)


def share(value: float | None) -> str:
    """'31.4 %'; 'unknown' where there is no number."""
    if value is None or not math.isfinite(value):
        return "unknown"
    return (f"{100 * value:#.3g}".rstrip(".") if abs(value) < 10 else f"{100 * value:.0f}").replace("-", "−") + " %"


def quantity(estimate: Estimate) -> str:
    """'0.312 ± 0.004 kg', '(1.02 ± 0.03)×10⁷ N/m'; the value alone where there is no standard error."""
    value, std, of_unit = estimate.value, estimate.std, unit(estimate.unit)
    if not finite(value):
        return "unknown"
    if finite(std) and abs(value) < 0.005 * std:
        value = 0.0
    size = max(abs(value), std if finite(std) else 0.0)
    power = math.floor(math.log10(size)) if size else 0
    if -3 <= power < 5:
        text = with_error(value, std) if finite(std) else number(value)
    else:
        scale = 10.0**power
        text = f"({with_error(value / scale, std / scale)})" if finite(std) and std > 0 else f"{value / scale:.4g}"
        text += ten_to(power)
    return f"{text} {of_unit}".rstrip().replace("-", "−")


def k_b_words(k_b: Estimate | None) -> str:
    """'10.02 ± 0.03', in MN/m; empty where no bearing was measured."""
    return stiffness_with_error(k_b.value, k_b.std) if k_b and finite(k_b.value) else ""


def k_b_interval(k_b: Estimate) -> str:
    """'9.97 to 10.07': the 90 % interval in MN/m."""
    return interval(k_b.value - Z90 * k_b.std, k_b.value + Z90 * k_b.std) if finite(k_b.std) else "unknown"


def title(effect_id: str) -> str:
    """An effect's title; its id where this version does not know it."""
    return EFFECTS[effect_id].title if effect_id in EFFECTS else effect_id


def cause_title(cause: Cause) -> str:
    """'Pedestal flexibility', or both of a pair."""
    return " + ".join(map(title, cause.effects)) or "No effect"


def cause_key(cause: Cause) -> tuple[Any, ...]:
    """What makes two entries of a diagnosis the same candidate."""
    return cause.effects, cause.location, tuple(cause.places.items())


def meanings(cause: Cause) -> list[tuple[str, str]]:
    """Title and one-line meaning of each effect."""
    return [(title(e), EFFECTS[e].meaning) for e in cause.effects if e in EFFECTS]


def places(cause: Cause) -> str:
    """Where each effect of a candidate sits."""
    words = [place(location) for location in cause.locations or (cause.location,)] if cause.effects else []
    return "; ".join(dict.fromkeys(filter(None, words)))


def parameters(cause: Cause) -> list[str]:
    """'stiffness (1.02 ± 0.03)×10⁷ N/m' for each parameter; of a pair with the effect's title.

    One at the end of its range has no standard error worth the name.
    """
    pair = len(cause.effects) > 1
    edge = set(cause.at_prior_edge)
    return [
        f"{_parameter_name(name, pair)} {quantity(_plain(estimate) if name in edge else estimate)}"
        for name, estimate in cause.parameters.items()
    ]


def _parameter_name(full_name: str, with_title: bool) -> str:
    effect, _, name = full_name.rpartition(".")
    words = name.replace("_", " ")
    return f"{title(effect)}: {words}" if with_title and effect else words


def at_edge(cause: Cause) -> str:
    """A remark on parameters that end where their prior ends; empty without any."""
    if not cause.at_prior_edge:
        return ""
    names = ", ".join(_parameter_name(name, len(cause.effects) > 1) for name in cause.at_prior_edge)
    return f"{names} at the end of the range that was searched"


def gap_before(diagnosis: Diagnosis) -> float | None:
    """The gap on held-out data, else that of the fit."""
    return diagnosis.shrink.before if diagnosis.shrink else diagnosis.nominal.get("gap")


def best_k_b(diagnosis: Diagnosis) -> Estimate | None:
    """The stiffness with the cause, where one is named, else the nominal model's."""
    with_cause = diagnosis.causes[0].k_b if diagnosis.names_a_cause else None
    return with_cause or diagnosis.nominal.get("k_b")


def explained(shrink: Shrink) -> str:
    """'99 % of what can be explained is explained; with another node driven, expect 97 % to 99 %'."""
    if not finite(shrink.explainable):
        return "the gap is the noise floor: there is nothing to explain"
    low, high = shrink.ci90
    known = finite(low) and finite(high)
    between = f"; with another node driven, expect {share(low)} to {share(high)}" if known else ""
    return f"{share(shrink.explainable)} of what can be explained is explained{between}"


def moved(number: Calibrated) -> float:
    """How far the data moved a number, in standard deviations of its prior; nan where it was not known at all."""
    prior, value = number.prior, number.posterior.value
    known = finite(prior.std) and prior.std > 0 and value > 0
    return math.log(value / prior.value) * prior.value / prior.std if known else math.nan


def calibration_words(numbers: Sequence[Calibrated]) -> str:
    """'Known at least twice as well as before: … Moved by more than one standard deviation of what was known: …'."""
    told = [n.words for n in numbers if n.posterior.std < n.prior.std / 2]
    far = [f"{n.words} ({_signed(moved(n))})" for n in numbers if abs(moved(n)) > 1]
    return (
        f"Known at least twice as well as before: {listed(told)}. "
        f"Moved by more than one standard deviation of what was known: {listed(far)}."
    )


def calibrated_row(number: Calibrated, *posteriors: Estimate | None) -> tuple[str, ...]:
    """A number in words, as it was known, as each model has it, and how far it moved."""
    after = ("" if p is None else quantity(p) for p in posteriors)
    return number.words, quantity(number.prior), *after, _signed(moved(number))


def repeatability_row(number: Calibrated, *posteriors: Estimate | None) -> tuple[str, ...]:
    """The same of a repeatability: learned from the runs, or stated."""
    words, prior, *after, _ = calibrated_row(number, *posteriors)
    return words, f"learned, usually {quantity(_plain(number.prior))}" if number.learned else f"{prior}, stated", *after


def _plain(estimate: Estimate) -> Estimate:
    """Without its standard error."""
    return replace(estimate, std=math.nan)


def _signed(value: float) -> str:
    """'+1.4', '−0.3'; empty where there is no number."""
    return f"{value:+.1f}".replace("-", "−") if finite(value) else ""


def run_toml(run: Mapping[str, Any]) -> str:
    """Settings of a run as a [[run]] table for campaign.toml."""
    return "\n".join(["[[run]]", *toml_lines(run)])
