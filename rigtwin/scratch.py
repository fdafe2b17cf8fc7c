"""Folders for temporary files, and files that are replaced completely or not at all.

What a killed program left is removed by the next one that makes such a folder or file: the owner of a folder holds a
lock on a file in it, which the system releases however the owner ends. Nothing here imports more than the standard
library.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # not on Windows, where nothing is swept
    fcntl = None

PREFIX = "rigtwin_"

_OWNED = ".owned"

# Errors of a write that do not say which file was written.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Scratch:
    """A new folder, ``path``; ``close`` removes it, at the latest at the end of the program.

    Parameters
    ----------
    name : how its name goes on after "rigtwin_"
    beside : a file that is being made. The folder is then a hidden one in the file's own folder, so that what is
        made in it can be renamed into place; by default it is one for temporary files

    Raises OSError where no folder can be made.
    """

    def __init__(self, name: str = "", *, beside: Path | None = None):
        parent = Path(tempfile.gettempdir()) if beside is None else beside.parent.absolute()
        family = PREFIX if beside is None else _family_of(beside)
        _sweep_once(parent, family)
        self.path = Path(tempfile.mkdtemp(prefix=f"{family}{name}", dir=parent))
        self.close = weakref.finalize(self, _remove, self.path, _own(self.path))

    def __enter__(self) -> Scratch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def scratch_folder(name: str = "", *, beside: Path | None = None) -> Iterator[Path]:
    """Path of a ``Scratch`` for as long as the block lasts; an OSError of a full disk gets its name."""
    with Scratch(name, beside=beside) as scratch:
        try:
            yield scratch.path
        except OSError as error:
            if error.filename is not None or error.errno not in _FULL:
                raise
            hint = "; make room, or set TMPDIR to another folder" if beside is None else ""
            raise OSError(error.errno, f"{error.strerror}{hint}", str(scratch.path)) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a free name in a folder beside ``path``; what is written there takes the place of ``path`` at the end.

    On any error the new file is removed and ``path`` stays as it was. The name is only reserved, not
    created, so that the file gets the permissions any new file gets. An OSError that does not say which file could not
    be written, as that of a full disk, is raised again with the name of ``path``.
    """
    try:
        with scratch_folder(beside=path) as folder:
            beside = folder / path.name
            yield beside
            os.replace(beside, path)
    except OSError as error:
        if error.filename is not None and _family_of(path) not in str(error.filename):
            raise
        raise OSError(error.errno or errno.EIO, f"cannot be written ({error.strerror or error})", str(path)) from error


def check_writable(path: Path) -> None:
    """Raises OSError where a file that work is to end in cannot be written; leaves nothing behind."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; give the file a name inside it", str(path))
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(error.errno, f"cannot be written ({folder}: {error.strerror})", str(path)) from error


def _family_of(file: Path) -> str:
    """How the names of the folders begin in which a file is made."""
    return f".{file.name}.{PREFIX}"


def sweep_leftovers() -> None:
    """Remove the folders for temporary files whose owners have ended."""
    with suppress(OSError):  # there is no folder for them
        _sweep_once(Path(tempfile.gettempdir()), PREFIX)


@cache
def _sweep_once(parent: Path, family: str) -> None:
    """Of the folders whose names begin like this remove those whose owners have ended; others are left alone."""
    if fcntl is None:
        return
    for folder in _folders(parent, family):
        try:
            lock = os.open(folder / _OWNED, os.O_RDWR)
        except OSError:  # another user's, or not made here
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:  # in use
            os.close(lock)
        else:
            _remove(folder, lock)


def _folders(parent: Path, family: str) -> list[Path]:
    try:
        with os.scandir(parent) as entries:
            found = [entry for entry in entries if entry.name.startswith(family)]
            return [Path(entry.path) for entry in found if entry.is_dir(follow_symlinks=False)]
    except OSError:
        return []


def _own(folder: Path) -> int:
    """Lock a folder; returns what ``_remove`` closes. The lock is there before its file has its name."""
    made = folder / f"{_OWNED}.new"
    lock = os.open(made, os.O_RDWR | os.O_CREAT | os.O_EXCL)
    if fcntl is not None:
        fcntl.flock(lock, fcntl.LOCK_EX)
    os.rename(made, folder / _OWNED)
    return lock


def _remove(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)
