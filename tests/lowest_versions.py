"""Whether the lowest versions that pyproject.toml declares are true: ``python -m tests.lowest_versions``.

They are installed together into build/lowest, and the tests that use these packages most are run there. A version that
another package does not go with is refused by pip, one that lacks what rigtwin calls fails a test.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import venv
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACE = ROOT / "build" / "lowest"
EXTRAS = ("train", "native", "dask")

# What each package is used for: command line, files, pages, FMUs, networks, clusters.
TESTS = (
    "tests/rigtwin/test_cli.py",
    "tests/rigtwin/test_files.py",
    "tests/rigtwin/test_report.py",
    "tests/rigtwin/test_sweep.py",
    "tests/rigtwin/test_scale_out.py",
    "tests/sim/test_formats.py",
    "tests/sim/test_campaign_folder.py",
    "tests/sim/test_session.py",
    "tests/rotor/test_rig.py",
    "tests/estimator/test_runtime.py",
    "tests/estimator/test_training.py",
    "tests/fmu/test_build.py",
    "tests/fmu/native/test_build_native.py",
)


def lowest(project: dict) -> Iterator[str]:
    """'numpy==2.1.3' of 'numpy>=2.1.3', for every requirement that has a lowest version."""
    extras = project["optional-dependencies"]
    for requirement in (*project["dependencies"], *(each for name in EXTRAS for each in extras[name])):
        if match := re.fullmatch(r"([A-Za-z0-9_.-]+)>=([0-9.]+)", requirement):
            yield f"{match[1]}=={match[2]}"


def main() -> int:
    """Install and test; returns the exit code of the tests."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    venv.create(PLACE, with_pip=True, clear=True)
    constraints = PLACE / "constraints.txt"
    constraints.write_text("\n".join(lowest(project)) + "\n", encoding="utf-8")
    print(constraints.read_text(encoding="utf-8"), flush=True)
    python = str(PLACE / "bin" / "python")
    package = f"{ROOT}[{','.join(EXTRAS)}]"
    tools = [each for each in project["optional-dependencies"]["dev"] if each.startswith(("pytest", "hypothesis"))]
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "-c", str(constraints), "-e", package, *tools], check=True
    )
    # Warnings of old versions about themselves are no errors here.
    command = [python, "-m", "pytest", "-W", "default", "-p", "no:cacheprovider", "-m", "not long", *TESTS]
    return subprocess.run(command, cwd=ROOT, env=os.environ, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
