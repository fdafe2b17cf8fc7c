"""Ctrl-C and SIGTERM: an interrupt that waits for a place where the code can be left, and an end at the second.

An FMU that is itself Python runs in this very interpreter, and its loader takes the KeyboardInterrupt for a
failure of the FMU, loses it, or crashes; so do imports of compiled modules. A folder half made or half deleted
stays behind.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)

# Exit code of an interrupted program, as shells have it.
_INTERRUPTED = 130

# The modules from which an FMU is called, and those that are not left before they are done.
_WHOLE = {"fmpy.fmi1", "fmpy.fmi2", "fmpy.fmi3", "rigtwin.sim.instances", "rigtwin.scratch"}
_WHOLE |= {"importlib._bootstrap", "shutil", "tempfile"}


def install() -> None:
    """Take both as an interrupt, so that nothing is left half-written or behind."""
    for number in _SIGNALS:
        signal.signal(number, _interrupt)


def end_at_the_second(again_after: float = 1.0) -> None:
    """End this process at a second signal, at once and wherever it is, if only a library's own loop.

    Workers end with it, and what it leaves in folders for temporary files the next command removes.

    Parameters
    ----------
    again_after : seconds within which a second signal is the first one, sent to a process and to its group
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reading, again_after), name="second signal", daemon=True).start()


def _watch(signals: int, again_after: float) -> None:
    first: float | None = None
    while number := os.read(signals, 1):
        if number[0] not in _SIGNALS:
            continue
        now = time.monotonic()
        first = first or now
        if now - first > again_after:
            os.write(2, b"rigtwin: interrupted\n")
            os._exit(_INTERRUPTED)


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
