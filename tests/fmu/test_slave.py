"""The table-driven slave by itself, with a model that can be told to fail."""

from __future__ import annotations

import gc
import json
import sys

import pytest

from rigtwin.fmu_src.slave import TableSlave
from rigtwin.fmu_src.variables import Variable


class Balance(TableSlave):
    """Refuses what ``failure`` says; its output is the sum of its inputs."""

    failure: Exception | None = None

    def accept_settings(self, changed):
        """Raise what the test asked for."""
        if self.failure:
            raise self.failure

    def compute_outputs(self):
        """The sum."""
        return [self.value("left") + self.value("right")]

    def advance(self, time, h):
        """Nothing to do."""


LEFT, RIGHT, SUM = range(3)


@pytest.fixture
def balance(tmp_path):
    facts = {"guid": "00000000-0000-0000-0000-000000000000", "version": "1"}
    (tmp_path / "manifest.json").write_text(json.dumps(facts))
    table = (
        Variable("left", "input", "left side", "N", 1.0),
        Variable("right", "input", "right side", "N", 2.0),
        Variable("sum", "output", "both sides", "N"),
    )
    return Balance(table, "a balance", 1.0, 1e-6, instance_name="balance", resources=str(tmp_path))


@pytest.mark.parametrize("failure", [ValueError("too heavy"), FloatingPointError("overflow"), KeyboardInterrupt()])
def test_when_the_model_refuses_the_values_all_of_them_go_back(balance, failure):
    """Values that pass the table's ranges, and of which the model then cannot be built."""
    balance.failure = failure
    with pytest.raises(type(failure)):
        balance.set_real([LEFT, RIGHT], [10.0, 20.0])
    balance.failure = None
    assert balance.get_real([LEFT, RIGHT, SUM]) == [1.0, 2.0, 3.0]


def test_a_refusal_names_the_instance_and_says_that_nothing_happened(balance):
    balance.failure = ValueError("too heavy")
    with pytest.raises(
        ValueError, match=r"^balance: too heavy\. The call has no effect; the instance is still usable\.$"
    ):
        balance.set_real([LEFT], [10.0])


@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt])
def test_every_failing_call_replaces_the_references_that_the_glue_will_drop(balance, kind):
    """Instance, class and log: one more of each for each call that raises, none for one that does not."""
    held = (balance, type(balance), balance.log_queue)

    def references():
        balance.failure = None
        gc.collect()  # tracebacks hold the instance too
        return [sys.getrefcount(thing) for thing in held]

    before = references()
    balance.set_real([LEFT], [5.0])
    assert references() == before
    for _ in range(10):
        balance.failure = kind("too heavy")
        with pytest.raises(kind):
            balance.set_real([LEFT], [10.0])
    assert [now - then for now, then in zip(references(), before, strict=True)] == [10, 10, 10]


def test_outputs_are_computed_only_when_something_changed(balance, monkeypatch):
    """A master that reads seven outputs in seven calls pays for one computation."""
    computed = []
    monkeypatch.setattr(Balance, "compute_outputs", lambda self: computed.append(1) or [0.0])
    for _ in range(7):
        balance.get_real([SUM])
    assert len(computed) == 1
    balance.set_real([LEFT], [5.0])
    balance.get_real([SUM])
    assert len(computed) == 2
