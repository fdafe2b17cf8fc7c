"""Ctrl-C and SIGTERM: an interrupt that waits for a place where the code can be left.

An FMU that is itself Python runs in this very interpreter, and its loader takes the KeyboardInterrupt for a
failure of the FMU, or loses it; so do imports of compiled modules. A folder half made or half deleted stays behind.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from types import FrameType

# The modules from which an FMU is called, and those that are not left before they are done.
_CALLERS = {"fmpy.fmi1", "fmpy.fmi2", "fmpy.fmi3", "sim.instances"}
_WHOLE = {"importlib._bootstrap", "shutil", "tempfile"}

_AGAIN = 0.005  # [s]


def install() -> None:
    """Take both as an interrupt, so that nothing is left half-written or behind."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _can_be_left(list(_modules(frame))):
        raise KeyboardInterrupt
    again = threading.Timer(_AGAIN, _thread.interrupt_main, (number,))
    again.daemon = True
    again.start()


def _modules(frame: FrameType | None) -> Iterator[str]:
    """The modules of the code that runs, the innermost first."""
    while frame is not None:
        yield frame.f_globals.get("__name__", "")
        frame = frame.f_back


def _can_be_left(modules: list[str]) -> bool:
    """Whether neither an FMU's call has led to Python code other than its caller's own, nor something must be whole."""
    own = next((i for i, module in enumerate(modules) if module in _CALLERS), 0)
    return own == 0 and _WHOLE.isdisjoint(modules)
