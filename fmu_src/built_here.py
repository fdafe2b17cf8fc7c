"""Which FMUs this installation has built: a list of their hashes, in the user's folder for the state of programs."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path


def record(fmu: Path) -> None:
    """Add an FMU to the list; where it cannot be written, the FMU counts as another's."""
    line = _hash(fmu)
    with suppress(OSError, RuntimeError):
        if line not in _lines():
            _list().parent.mkdir(parents=True, exist_ok=True)
            with _list().open("a", encoding="ascii") as file:
                file.write(f"{line}\n")


def is_built_here(fmu: Path) -> bool:
    """Whether a file is, byte for byte, an FMU that this user's rigtwin has built."""
    with suppress(OSError, RuntimeError, UnicodeDecodeError):
        return _hash(fmu) in _lines()
    return False


def _hash(fmu: Path) -> str:
    with fmu.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _lines() -> set[str]:
    return set(_list().read_text(encoding="ascii").split()) if _list().exists() else set()


def _list() -> Path:
    """Raises RuntimeError where there is no home folder."""
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / "rigtwin" / "built-fmus.sha256"
