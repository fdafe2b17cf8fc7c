"""The FMUs under the address and the undefined-behaviour sanitizer.

``python -m tests.fmu.native.sanitizers 100000`` runs the FMUs' tests, and then makes so many sequences of
random calls of each of the four FMUs, in parts with a seed each; an hour. It needs gcc on Linux.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rigtwin.fmu_src.build import FMI_HEADERS, build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import load_rig

HERE = Path(__file__).parent
FLAGS = ("-std=c99", "-g", "-O1", "-ffp-contract=off", "-fsanitize=address,undefined,float-cast-overflow")
STRICT = ("-fno-sanitize-recover=all", "-Wall", "-Wextra", "-Werror")
PART = 5000

# Set where FMUs are to be built with sanitizers; see conftest.py.
SANITIZED = "RIGTWIN_TESTS_SANITIZED"


def program(fmu: Path, fmi: str, folder: Path) -> Path:
    """The sources of an FMU and the random calls, compiled with the sanitizers."""
    shutil.unpack_archive(fmu, folder, format="zip")
    made, calls = folder / "random_calls", HERE / f"random_calls{fmi[0]}.c"
    compiler = shutil.which("cc")
    assert compiler, "a C compiler with sanitizers is needed: apt install gcc"
    includes = [f"-isystem{FMI_HEADERS}", f"-I{folder / 'sources'}", f"-I{HERE}"]
    files = sorted((folder / "sources").glob("*.c"))
    subprocess.run([compiler, *FLAGS, *STRICT, *includes, *files, calls, "-o", made, "-lm"], check=True)
    return made


def run(made: Path, seed: int, sequences: int) -> str:
    """What the program says of so many sequences; raises CalledProcessError where a sanitizer finds something."""
    command = [str(made), str(seed), str(sequences)]
    finished = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    if finished.returncode:
        print(finished.stderr, file=sys.stderr)
        finished.check_returncode()
    return finished.stdout


def sanitized_compiler(_target: object) -> list[str]:
    """In place of the compiler that FMUs are built with."""
    return ["gcc", "-g", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]


def suite() -> None:
    """The tests of the FMUs, on FMUs that watch themselves; raises CalledProcessError where one fails."""
    names = ("libasan.so", "libstdc++.so")  # the second, so that the first finds what throws
    ask = [["gcc", f"-print-file-name={name}"] for name in names]
    runtimes = [subprocess.run(one, capture_output=True, text=True, check=True).stdout.strip() for one in ask]
    watched = {"LD_PRELOAD": " ".join(runtimes), "ASAN_OPTIONS": "detect_leaks=0:quarantine_size_mb=1", SANITIZED: "1"}
    tests = [str(HERE / f"{name}.py") for name in ("test_core", "test_fmi3", "test_all_again")]
    subprocess.run([sys.executable, "-m", "pytest", "-x", *tests], env=os.environ | watched, check=True)
    print("the tests of the FMUs, with sanitizers: nothing found", flush=True)


def main(sequences: int) -> None:
    """The tests, then both FMUs in both versions of FMI."""
    suite()
    rig, target = load_rig("nit-rourkela"), [this_machine()]
    with tempfile.TemporaryDirectory(prefix="random_calls_") as scratch:
        for fmi in ("2.0", "3.0"):
            folder = Path(scratch) / fmi
            for fmu in (
                build_native_rotor_fmu(rig, folder, fmi=fmi, targets=target),
                build_native_estimator_fmu(folder, fmi=fmi, targets=target),
            ):
                made = program(fmu, fmi, folder / fmu.stem)
                for seed in range(0, sequences, PART):
                    run(made, seed + 1, min(PART, sequences - seed))
                print(f"{fmu.stem}, FMI {fmi}: {sequences} sequences of random calls, nothing found", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
