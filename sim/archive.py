"""The file of an FMU, read within limits: a damaged or malicious archive is one sentence."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from fmpy import read_model_description
from fmpy.model_description import ModelDescription

from rigtwin.scratch import scratch_folder

DESCRIPTION = "modelDescription.xml"

# What an FMU may hold. A megabyte of zeros is a kilobyte in an archive.
MOST_FILES = 20_000
MOST_BYTES = 1 << 30
MOST_BYTES_OF_DESCRIPTION = 1 << 26


class FmuError(RuntimeError):
    """An FMU cannot be read, or a call failed; the message carries what the FMU wrote to its log."""


class ArchiveError(FmuError):
    """The file cannot be read as an FMU; ``why`` is the reason alone."""

    def __init__(self, fmu: str | Path, why: str):
        super().__init__(f"{fmu} cannot be read as an FMU: {why}")
        self.why = why


def describe(fmu: str | Path) -> ModelDescription:
    """The model description of an FMU, of which nothing is unpacked or run. Raises ArchiveError."""
    with scratch_folder("xml_") as folder:
        content = read_member(fmu, DESCRIPTION, MOST_BYTES_OF_DESCRIPTION)
        if content is None:
            raise ArchiveError(fmu, f"it holds no {DESCRIPTION}")
        (folder / DESCRIPTION).write_bytes(content)
        return describe_unpacked(fmu, folder)


def describe_unpacked(fmu: str | Path, folder: Path) -> ModelDescription:
    """The same of an FMU that is unpacked into a folder."""
    try:
        return read_model_description(folder)
    except Exception as error:  # fmpy raises bare Exception, lxml and the operating system their own
        raise ArchiveError(fmu, str(error) or type(error).__name__) from error


def read_member(fmu: str | Path, name: str, most_bytes: int = MOST_BYTES) -> bytes | None:
    """Content of one file in an FMU, checked by its sum; None where there is no such file. Raises ArchiveError."""
    with _opened(fmu) as archive:
        if name not in archive.namelist():
            return None
        if (size := archive.getinfo(name).file_size) > most_bytes:
            raise ArchiveError(fmu, f"{name} has {size / 1e6:.0f} MB, the limit is {most_bytes / 1e6:.0f} MB")
        return archive.read(name)


def unpack(fmu: str | Path, folder: Path) -> None:
    """Unpack an FMU into an empty folder. Raises FmuError."""
    with _opened(fmu) as archive:
        for info in archive.infolist():
            place = PurePosixPath(info.filename)
            if "\\" in info.filename or ":" in info.filename or place.is_absolute() or ".." in place.parts:
                raise ArchiveError(fmu, f"a file in it has the name {info.filename[:80]!r}")
            target = folder / place
            if info.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(info) as source, _written(fmu, folder, target) as copy:
                shutil.copyfileobj(source, copy, 1 << 20)


@contextmanager
def _written(fmu: str | Path, folder: Path, target: Path) -> Iterator:
    try:
        with target.open("wb") as copy:
            yield copy
    except OSError as error:
        raise FmuError(
            f"{fmu} cannot be unpacked into {folder} ({error.strerror}); make room there, or set TMPDIR to another "
            "folder"
        ) from error


@contextmanager
def _opened(fmu: str | Path) -> Iterator[zipfile.ZipFile]:
    """The archive, once it is known how much it holds. Whatever fails inside becomes an ArchiveError."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            infos = archive.infolist()
            if len(infos) > MOST_FILES:
                raise ArchiveError(fmu, f"it holds {len(infos)} files, the limit is {MOST_FILES}")
            if (total := sum(info.file_size for info in infos)) > MOST_BYTES:
                raise ArchiveError(fmu, f"unpacked it has {total / 1e6:.0f} MB, the limit is {MOST_BYTES / 1e6:.0f} MB")
            if any(info.flag_bits & 1 for info in infos):
                raise ArchiveError(fmu, "it is encrypted")
            yield archive
    except FmuError:
        raise
    except Exception as error:  # zipfile, zlib, bz2 and lzma raise many kinds on a damaged archive
        raise ArchiveError(fmu, str(error) or type(error).__name__) from error
