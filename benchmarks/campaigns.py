"""Campaigns of the blind generator that benchmarks diagnose."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

from rigtwin.blind.generate.campaigns import Order, make
from rigtwin.blind.generate.draw import library_effect
from rigtwin.blind.generate.effects import NONLINEAR
from rigtwin.blind.generate.folder import MEASURED
from rigtwin.blind.judge.score import Label, label_from


def tuning_campaigns(name: str, seed: int, folder: Path, nonlinear: bool = False) -> Iterator[tuple[Path, Label]]:
    """Folders and labels of a set's campaigns of the tuning split, each made when it is asked for.

    Parameters
    ----------
    name : of the set, "W1" for example
    folder : where they are made
    nonlinear : those at several force levels; default those at one
    """
    for index in itertools.count():
        if name == "W1" and (library_effect(index) in NONLINEAR) != nonlinear:
            continue  # making a nonlinear campaign takes as long as its diagnosis
        order = Order(name, "tuning", seed, index)
        label = label_from(make(order, folder))
        if (len(label.levels) > 1) == nonlinear:
            yield folder / order.name / MEASURED, label
