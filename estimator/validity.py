"""Why an estimate is not valid, in sentences: the network itself says only that it is not."""

from __future__ import annotations

from typing import Any

from rigtwin.estimator.features import Features
from rigtwin.estimator.runtime import Estimate

_UNITS = {"delta_f1": " Hz", "delta_f2": " Hz", "amplitude_ratio": ""}


def objections(features: Features, estimate: Estimate, card: dict[str, Any]) -> list[str]:
    """What speaks against using an estimate; empty where it is valid.

    Parameters
    ----------
    features : what the estimate was made from
    estimate : the network's answer
    card : the network's model card

    >>> objections(Features(4.0, 26.0, 1.2, 0.01, 0.02, 0.01), Estimate(1e7, 1e4, 9.9e6, 1.01e7, valid=True), card={})
    []
    """
    if estimate.valid:
        return []
    limits = card["training_range"]
    low = [*limits["shift_min"], limits["ratio"][0]]
    high = [*limits["shift_max"], limits["ratio"][1]]
    share = limits["relative_std_max"]
    found = []
    for (name, unit), least, most in zip(_UNITS.items(), low, high, strict=True):
        value, std = getattr(features, name), getattr(features, f"{name}_std")
        if not least <= value <= most:
            found.append(f"{name} = {value:.4g}{unit} is outside the trained range {least:.4g} to {most:.4g}{unit}")
        elif not 0 <= std <= share * value:
            found.append(f"{name}_std = {std:.3g}{unit} is not between 0 and {share:.0%} of {name} = {value:.4g}{unit}")
    if found:
        return found
    k_low, k_high = limits["k_b"]
    if not k_low <= estimate.k_b <= k_high:
        return [f"k_b = {estimate.k_b:.4g} N/m is outside the range {k_low:.3g} to {k_high:.3g} N/m it answers for"]
    return [
        "the inputs contradict each other: no one k_b gives these two shifts and this amplitude ratio "
        "within their standard errors"
    ]
