"""Seconds that each step of a diagnosis takes."""

from __future__ import annotations

import time


class Clock:
    """Seconds of one step of the work after the other."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """A step has ended; its times add up where it is done again."""
        now = time.perf_counter()
        self.laps[name], self._last = self.laps.get(name, 0.0) + now - self._last, now
