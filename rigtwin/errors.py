"""The one error that a user sees, on the command line and in Python."""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

# Errors that say in a sentence what is wrong with the input. An exception of one of these classes
# can only be there when its module has been loaded, so none is loaded for asking.
_SENTENCES = {
    "rigtwin.rotor.geometry.rig": ("RigError",),
    "rigtwin.sim.campaign": ("MeasurementError",),
    "rigtwin.sim.session": ("FmuError",),
    "rigtwin.sim.setup": ("SetupError",),
    "rigtwin.sim.stepped_sine": ("NotSettledError",),
}

# What a host makes of an FMU's refusal: "... ValueError('RotorRig: k_b must be ... .')" of pythonfmu's glue,
# "... failed with status 3 (error).: RotorRig: k_b must be ... ." of the compiled one.
_FMU_WORDS = re.compile(
    r"""ValueError\((['"])(.+?)(?: The call has no effect; .*)?\1\)"""
    r"""|status 3 \(error\)\.: (.+?) The call has no effect"""
)


class UserError(Exception):
    """The user's input is wrong; the message says what, where, and what to do."""


def existing(path: Path) -> Path:
    """The path, when there is such a file. Raises UserError."""
    if not path.is_file():
        raise UserError(f"{path}: no such file; check its name and folder")
    return path


def for_users(function: Callable[P, R]) -> Callable[P, R]:
    """A function of the Python interface: whatever is wrong with its input is raised as UserError.

    >>> @for_users
    ... def read(name):
    ...     return open(name).read()
    >>> read("no-such-file.csv")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: no-such-file.csv: No such file or directory
    """

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except UserError:
            raise
        except (OSError, *wrong_input()) as error:
            raise UserError(in_a_sentence(error)) from error

    return call


def wrong_input() -> tuple[type[Exception], ...]:
    """The classes of all errors whose message is for the user, of the modules that are loaded."""
    loaded = ((sys.modules.get(module), names) for module, names in _SENTENCES.items())
    return (UserError, *(getattr(module, name) for module, names in loaded if module for name in names))


def in_a_sentence(error: Exception) -> str:
    """An error's message in one line; of a file, its name first; of an FMU, its own words without the host's."""
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror or error}" if error.filename else str(error.strerror or error)
    text = " ".join(str(error).split())
    words = _FMU_WORDS.search(text)
    return words.group(2) or words.group(3) if words else text
