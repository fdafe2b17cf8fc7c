"""A diagnosis that goes on in a process of its own, as the app sees it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

WORKER = (sys.executable, "-m", "rigtwin.app.worker")

# Letters of what the process says of its own fault.
_LONGEST = 1500


@dataclass(frozen=True)
class Step:
    """How far a diagnosis has come."""

    words: str
    done: int
    total: int

    def goes_on_with(self, other: Step) -> bool:
        """Whether the other one is a later step of the same stage, which counts on to the same total."""
        return other.total == self.total and other.done >= self.done


@dataclass
class State:
    """What there is to see of a diagnosis."""

    name: str
    steps: list[Step] = field(default_factory=list)  # the last step of each stage, in their order
    sentence: str = ""  # the verdict
    error: str = ""
    cancelled: bool = False

    @property
    def ended(self) -> bool:
        """Whether nothing more comes."""
        return bool(self.sentence or self.error or self.cancelled)


class Job:
    """A diagnosis of a campaign's folder; its files are written into another one.

    Parameters
    ----------
    name : of the campaign, for a reader
    campaign, out : folders
    temporary : folder for what the process keeps for itself
    worker : the command that diagnoses
    """

    def __init__(self, name: str, campaign: Path, out: Path, temporary: Path, worker: Sequence[str] = WORKER):
        self.state = State(name)
        self.out = out
        self._said: list[str] = []
        self._process = subprocess.Popen(
            [*worker, str(campaign), str(out)],
            stdin=subprocess.PIPE,  # its other end: closed when this process ends, however it ends
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            env={**os.environ, "TMPDIR": str(temporary)},
        )
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._watch, self._listen)]
        for reader in self._readers:
            reader.start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def cancel(self) -> None:
        """End the process at once, if it still runs."""
        if not self.state.ended:
            self.state.cancelled = True
        self._process.kill()
        for reader in self._readers:  # they end with the process
            reader.join()
        self._process.communicate()  # closes the pipes

    def _watch(self) -> None:
        """Take down what the process tells, and how it ends."""
        assert self._process.stdout
        for line in self._process.stdout:
            self._take(json.loads(line))
        code = self._process.wait()
        if not self.state.ended:
            self._readers[1].join(1.0)
            said = "".join(self._said).strip()[-_LONGEST:]
            self.state.error = f"The diagnosis ended without a result (exit code {code}). {said}".strip()

    def _take(self, told: dict[str, object]) -> None:
        steps = self.state.steps
        if "words" in told:
            step = Step(str(told["words"]), int(str(told["done"])), int(str(told["total"])))
            if steps and steps[-1].goes_on_with(step):
                steps[-1] = step
            else:
                steps.append(step)
        self.state.error = str(told.get("error", self.state.error))
        self.state.sentence = str(told.get("sentence", self.state.sentence))

    def _listen(self) -> None:
        """Keep the end of what the process says beside."""
        assert self._process.stderr
        for line in self._process.stderr:
            self._said = [*self._said[-19:], line]
