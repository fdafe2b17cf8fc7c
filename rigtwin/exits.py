"""Exit codes, and what a user sees when something goes wrong.

0 done; 1 our fault, with a traceback; 2 the user's input is wrong, one message; 3 a gate failed;
130 interrupted.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from typing import Any

from typer.core import TyperGroup
from typer.exceptions import Abort, TyperException

from rigtwin.errors import UserError as UserError
from rigtwin.errors import in_a_sentence, wrong_input

__all__ = ["CommandGroup", "UserError", "complain"]

# Characters of a message, and of those the first where some in the middle are left out.
_LONGEST, _BEGINNING = 493, 340

OUR_FAULT, WRONG_INPUT, GATE_FAILED, INTERRUPTED = 1, 2, 3, 130


class CommandGroup(TyperGroup):
    """Turns every exception of a command into a message and an exit code."""

    def main(self, args: Sequence[str] | None = None, *other: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run and exit; ``standalone_mode`` is what Typer's test runner passes."""
        try:
            code = super().main(args, *other, standalone_mode=False, **extra)
        except TyperException as error:
            code = complain(f"{error.format_message().removesuffix('.')}. See rigtwin COMMAND --help.", error.exit_code)
        except (Abort, KeyboardInterrupt):
            code = INTERRUPTED
        except (OSError, *wrong_input()) as error:
            code = complain(in_a_sentence(error), WRONG_INPUT)
        except Exception:
            code = _own_fault()
        if code == INTERRUPTED:
            complain("interrupted", code)
        sys.exit(code or 0)


def complain(message: str, code: int) -> int:
    """Print one message on stderr, of a length that is read; returns the exit code."""
    print(f"rigtwin: {readable(message)}", file=sys.stderr)
    return code


def readable(message: str) -> str:
    """A message without what only a terminal reads; of a long one the beginning and the end, which say what and how.

    >>> readable("a" * 300 + "b" * 300 + "c" * 100) == "a" * 300 + "b" * 40 + " … " + "b" * 50 + "c" * 100
    True
    """
    text = "".join(letter if letter.isprintable() else " " for letter in message)
    return text if len(text) <= _LONGEST else f"{text[:_BEGINNING]} … {text[_BEGINNING + 3 - _LONGEST :]}"


def _own_fault() -> int:
    traceback.print_exc()
    return complain("this is a fault of rigtwin, not of your input; please report it with the lines above", OUR_FAULT)
