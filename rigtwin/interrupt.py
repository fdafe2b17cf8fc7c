"""Ctrl-C and SIGTERM: an interrupt that waits for a place where the code can be left.

An FMU that is itself Python runs in this very interpreter, and its loader takes the KeyboardInterrupt for a
failure of the FMU, loses it, or crashes; so do imports of compiled modules. A folder half made or half deleted
stays behind.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Any

# The modules from which an FMU is called, and those that are not left before they are done.
_WHOLE = {"fmpy.fmi1", "fmpy.fmi2", "fmpy.fmi3", "rigtwin.sim.instances", "importlib._bootstrap", "shutil", "tempfile"}


def install() -> None:
    """Take both as an interrupt, so that nothing is left half-written or behind."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    place = _place(frame)
    if place is frame:
        raise KeyboardInterrupt
    if place is not None:  # it is None once the interpreter itself tidies up
        place.f_trace, place.f_trace_opcodes = _leave, True  # a line may be the first outside a try or with
        sys.settrace(lambda *_: None)  # without one, Python does not look at the frame's own


def _place(frame: FrameType | None) -> FrameType | None:
    """The innermost frame that nothing runs in which must come to its end."""
    place = frame
    while frame is not None:
        if frame.f_globals.get("__name__") in _WHOLE:
            place = frame.f_back
        frame = frame.f_back
    return place


def _leave(frame: FrameType, event: str, argument: Any) -> None:
    """As soon as the frame itself goes on."""
    sys.settrace(None)
    frame.f_trace, frame.f_trace_opcodes = None, False
    raise KeyboardInterrupt
