"""Files that are replaced completely or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def check_writable(path: Path) -> None:
    """Raises OSError where a file that work is to end in cannot be written; leaves nothing behind."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; give the file a name inside it", str(path))
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(error.errno, f"cannot be written ({folder}: {error.strerror})", str(path)) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a free name beside ``path``; what is written there takes the place of ``path`` at the end.

    On any error the new file is removed and ``path`` stays as it was. The name is only reserved, not
    created, so that the file gets the permissions any new file gets.
    """
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
