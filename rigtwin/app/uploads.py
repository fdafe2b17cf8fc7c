"""Files that a browser sends, checked before they are written: a campaign's folder as a .zip, or its files."""

from __future__ import annotations

import io
import lzma
import stat
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import IO

from rigtwin.errors import UserError

CAMPAIGN = "campaign.toml"

# What a campaign consists of; other files, such as notes and pictures, are left out.
SUFFIXES = (".toml", ".csv", ".txt", ".uff", ".unv", ".h5", ".hdf5", ".mat")

MEGABYTE = 1_000_000
MOST_SENT = 64 * MEGABYTE  # bytes of one upload
MOST_UNPACKED = 256 * MEGABYTE  # bytes of all its files
MOST_FILES = 1000

_CHUNK = 1 << 16


def unpack(sent: Sequence[tuple[str, bytes]], folder: Path) -> Path:
    """Write what was sent into a folder that is empty; returns the folder of the campaign in it.

    Parameters
    ----------
    sent : name and content of each file; of a .zip, what it holds is written

    Raises
    ------
    UserError : it is too large, an archive is damaged or wants to write elsewhere, or there is no campaign
    """
    if sum(len(content) for _, content in sent) > MOST_SENT:
        raise UserError(f"the files are larger than {MOST_SENT // MEGABYTE} MB together; leave out what is no data")
    budget = _Budget()
    for name, content in sent:
        if name.lower().endswith(".zip"):
            _unpack_archive(name, content, folder, budget)
        else:
            _write(io.BytesIO(content), folder, PurePosixPath(_plain(name).name), budget)
    return _campaign_in(folder)


class _Budget:
    """How much may still be written."""

    def __init__(self) -> None:
        self.n_bytes, self.n_files = MOST_UNPACKED, MOST_FILES

    def take(self, n_bytes: int) -> None:
        """Raises UserError where there is no more."""
        self.n_bytes -= n_bytes
        if self.n_bytes < 0:
            raise UserError(f"the files are larger than {MOST_UNPACKED // MEGABYTE} MB when they are unpacked")

    def take_file(self) -> None:
        """Raises UserError where there is no more."""
        self.n_files -= 1
        if self.n_files < 0:
            raise UserError(f"there are more than {MOST_FILES} files; send those of one campaign")


def _unpack_archive(name: str, content: bytes, folder: Path, budget: _Budget) -> None:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            for entry in _files_of(name, archive):
                with archive.open(entry) as source:
                    _write(source, folder, _plain(entry.filename), budget)
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, OSError, RuntimeError, EOFError, ValueError) as error:
        raise UserError(f"{name}: not an archive that can be read ({error}); pack the folder again") from error


def _files_of(name: str, archive: zipfile.ZipFile) -> Iterator[zipfile.ZipInfo]:
    """The files of an archive that stay inside its folder. Raises UserError for others."""
    for entry in archive.infolist():
        path = _plain(entry.filename)
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise UserError(f"{name}: {entry.filename} is a link; pack the file itself")
        if path.is_absolute() or ".." in path.parts or ":" in entry.filename or "\0" in entry.filename:
            raise UserError(f"{name}: {entry.filename} lies outside the archive; pack the folder again")
        if not entry.is_dir():
            yield entry


def _plain(name: str) -> PurePosixPath:
    """A path whoever wrote it; programs for Windows write backslashes."""
    return PurePosixPath(name.replace("\\", "/"))


def _write(source: IO[bytes], folder: Path, name: PurePosixPath, budget: _Budget) -> None:
    """One file in chunks, so that it is stopped when it grows too large, whatever its archive says of its size."""
    budget.take_file()
    if name.suffix.lower() not in SUFFIXES or name.name.startswith("."):
        return
    target = folder / name
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        file = target.open("xb")
    except OSError as error:
        raise UserError(f"{str(name)[:60]}: cannot be stored ({error.strerror}); rename it") from error
    with file:
        while chunk := source.read(_CHUNK):
            budget.take(len(chunk))
            file.write(chunk)


def _campaign_in(folder: Path) -> Path:
    """The folder of the one campaign.toml. Raises UserError where there is none, or where there are several."""
    found = sorted(path for path in folder.rglob(CAMPAIGN) if "__MACOSX" not in path.parts)
    if not found:
        raise UserError(f"there is no {CAMPAIGN} among the files; see docs/campaign-format.md for what it says")
    if len(found) > 1:
        names = ", ".join(str(path.parent.relative_to(folder)) for path in found[:4])
        raise UserError(f"there are {len(found)} campaigns ({names}); send one")
    return found[0].parent
