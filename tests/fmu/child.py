"""Runs a function in a Python process of its own, as a host that has nothing of the test's.

An FMU through pythonfmu lives in its host's Python: what the host has imported, its working
directory and its end can all matter, and a bad call can end it. So such tests run in a child.
"""

from __future__ import annotations

import inspect
import json
import os
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

_SCRIPT = """
from __future__ import annotations
import json, sys
{source}
print(json.dumps({name}(*json.loads(sys.argv[1]))))
"""


class ChildDiedError(AssertionError):
    """The child ended with another exit code than 0, or ran out of time."""


def in_child(
    function: Callable[..., Any],
    *arguments: Any,
    using: Sequence[Callable[..., Any]] = (),
    options: Sequence[str] = (),
    **environment: str,
) -> Any:
    """What the function returns in a process of its own, started in an empty working directory.

    Its source is run, not the function itself: it must import all that it uses. Arguments and
    result travel as JSON, paths as text.

    Parameters
    ----------
    function : self-contained function
    arguments : its arguments
    using : further self-contained functions that it calls
    options : options of the Python interpreter
    environment : variables added to the environment

    Raises
    ------
    ChildDiedError : with what the child wrote to its error stream
    """
    sources = [textwrap.dedent(inspect.getsource(f)) for f in (*using, function)]
    script = _SCRIPT.format(source="\n".join(sources), name=function.__name__)
    with tempfile.TemporaryDirectory(prefix="elsewhere_") as elsewhere:
        finished = subprocess.run(
            [sys.executable, *options, "-c", script, json.dumps(arguments, default=str)],
            cwd=elsewhere,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    if finished.returncode != 0:
        raise ChildDiedError(f"{function.__name__} ended with {finished.returncode}:\n{finished.stderr}")
    return json.loads(finished.stdout.splitlines()[-1])
