"""Decodes one HDF5 or MATLAB file, as a program: ``python decoder.py hdf5|matlab FILE``.

The libraries that read these files crash, hang or take all memory where a file is damaged. So they run in a process of
its own, with limits on time and memory, that imports nothing of this project (``in_child`` starts it). It prints an
archive of arrays: "names" of the variables, "attributes" with the names of the file's attributes, and the values of the
first and then of the second as "v0", "v1" and so on. What is neither number nor text comes as an array of nothing.
"""

from __future__ import annotations

import io
import math
import resource
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

MOST_BYTES = 1 << 30
MOST_SECONDS = 8
MOST_VALUES = 1 << 25  # of one array


class RefusedError(ValueError):
    """A file that asks for more than a run's data need."""


def main(kind: str, path: Path) -> None:
    """Print the variables of a file. Exits 3 with one line on stderr where it cannot be read."""
    if kind == "matlab":
        import scipy.io  # noqa: F401 - none of the time that the file takes

    try:
        with open("/proc/self/statm", encoding="ascii") as statm:
            used = int(statm.read().split()[0]) * resource.getpagesize()
    except OSError:
        used = MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
    begun = resource.getrusage(resource.RUSAGE_SELF)  # importing the libraries is no fault of the file
    last = math.ceil(begun.ru_utime + begun.ru_stime) + MOST_SECONDS
    resource.setrlimit(resource.RLIMIT_CPU, (last, last))
    try:
        variables, attributes = DECODERS[kind](path)
        arrays = {f"v{k}": _plain(v) for k, v in enumerate((*variables.values(), *attributes.values()))}
    except MemoryError:
        _fail(f"it asks for more than {MOST_BYTES >> 20} MB of memory")
    except Exception as error:  # the libraries raise many kinds on a damaged file
        _fail(str(error.args[0] if isinstance(error, KeyError) and error.args else error) or type(error).__name__)
    buffer = io.BytesIO()
    names, attribute_names = (np.array(list(each), dtype=str) for each in (variables, attributes))
    np.savez(buffer, allow_pickle=False, names=names, attributes=attribute_names, **arrays)
    sys.stdout.buffer.write(buffer.getvalue())


def _fail(why: str) -> None:
    print(" ".join(why.replace("\0", " ").split())[:300], file=sys.stderr)
    sys.exit(3)


def _plain(value: Any) -> np.ndarray:
    """Numbers or text as they are; an array of nothing for all else."""
    array = np.asarray(value)
    if array.dtype.kind == "O" and all(isinstance(each, str) for each in array.ravel().tolist()):
        array = array.astype(str)
    return array if array.dtype.kind in "biufcUS" else np.zeros(0, dtype="V1")


def _hdf5(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    with h5py.File(path, "r") as file:
        return dict(_datasets(file, _contents)), dict(_attributes(file))


def _attributes(file: Any) -> Iterator[tuple[str, Any]]:
    for name in file.attrs:
        try:
            yield name, file.attrs[name]
        except Exception:  # only those that a run knows are needed
            yield name, None


def _datasets(file: Any, contents: Callable[[Any], Any]) -> Iterator[tuple[str, Any]]:
    """What stands at the root of an HDF5 file, itself and not by a link to another file; a group as None."""
    for name in file:
        if isinstance(file.get(name, getlink=True), h5py.ExternalLink):
            raise RefusedError(f"{name!r} is a link to another file; copy what it holds into this one")
        item = file[name]
        if not isinstance(item, h5py.Dataset):
            yield name, None
            continue
        if item.is_virtual or item.external:
            raise RefusedError(f"{name!r} is kept in another file; copy what it holds into this one")
        if item.size and item.size > MOST_VALUES:
            raise RefusedError(f"{name!r} has {item.size} values; a run's arrays have at most {MOST_VALUES}")
        yield name, contents(item)


def _contents(item: Any) -> Any:
    return item.asstr(errors="replace")[()] if h5py.check_string_dtype(item.dtype) else item[()]


def _matlab(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    if h5py.is_hdf5(path):
        with h5py.File(path, "r") as file:
            return dict(_datasets(file, _matlab_array)), {}
    import scipy.io

    return scipy.io.loadmat(path, appendmat=False), {}


def _matlab_array(item: Any) -> Any:
    """A MATLAB 7.3 array as MATLAB shows it: axes in HDF5 are reversed, text is numbers, complex a pair."""
    array = np.asarray(item[()]).T
    if item.attrs.get("MATLAB_class") == b"char":
        return np.array("".join(map(chr, array.ravel())))
    if array.dtype.names == ("real", "imag"):
        values = np.empty(array.shape, dtype=complex)
        values.real, values.imag = array["real"], array["imag"]
        return values
    return array


DECODERS = {"hdf5": _hdf5, "matlab": _matlab}

if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
