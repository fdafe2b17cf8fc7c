"""Files that are replaced completely or not at all."""

from __future__ import annotations

import errno
import tempfile
from pathlib import Path

from rigtwin.scratch import replacing

__all__ = ["check_writable", "replacing"]


def check_writable(path: Path) -> None:
    """Raises OSError where a file that work is to end in cannot be written; leaves nothing behind."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; give the file a name inside it", str(path))
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(error.errno, f"cannot be written ({folder}: {error.strerror})", str(path)) from error
