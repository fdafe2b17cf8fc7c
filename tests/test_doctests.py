"""The examples in the docstrings are right: every ``>>>`` of the public modules is run."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from types import ModuleType

import numpy as np
import pytest

from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.force_laws import CUBIC
from rigtwin.rotor.model.rotor_model import build_system

# Packages whose docstrings have examples, and how many of their modules have one at least.
ROOMS = {
    "rigtwin.rotor": 20, "rigtwin.sim": 8, "rigtwin.estimator": 5, "rigtwin.gap": 6, "rigtwin.blind": 2,
    "rigtwin.api": 10,
}  # fmt: skip

# Modules that need torch, which is only installed for training.
NEEDS_TORCH = {"rigtwin.estimator.network", "rigtwin.estimator.training"}

# Names that every example may use besides those of its own module, so that an example stays short.
NAMES = {
    "np": np,
    "CUBIC": CUBIC,
    "EFFECTS": EFFECTS,
    "Condition": Condition,
    "assemble": assemble,
    "build_system": build_system,
    "load_rig": load_rig,
}


def modules_of(room: str) -> list[str]:
    """Names of all modules of a package that can be imported without torch."""
    package = importlib.import_module(room)
    found = [module.name for module in pkgutil.walk_packages(package.__path__, f"{room}.")]
    return [name for name in found if name not in NEEDS_TORCH]


def examples_in(module: ModuleType) -> list[doctest.DocTest]:
    """The docstrings of a module that have an example."""
    tests = doctest.DocTestFinder(exclude_empty=True).find(module, extraglobs=NAMES)
    return [test for test in tests if test.examples]


@pytest.mark.parametrize("name", ["rigtwin", "rigtwin.errors", *(n for room in ROOMS for n in modules_of(room))])
def test_the_examples_of_a_module_give_what_they_say(name):
    for test in examples_in(importlib.import_module(name)):
        report: list[str] = []
        result = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS).run(test, out=report.append)
        assert not result.failed, "".join(report)


@pytest.mark.parametrize("room", ROOMS)
def test_enough_modules_have_examples(room):
    with_examples = [name for name in modules_of(room) if examples_in(importlib.import_module(name))]
    assert len(with_examples) >= ROOMS[room], with_examples
