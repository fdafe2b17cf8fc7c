"""C sources to shared libraries, for this machine and, with ziglang, for every other."""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

# No fused operations and no reordering: every platform computes the same digits.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s")


class CompileError(RuntimeError):
    """There is no compiler, it failed, or there is nothing for it to compile."""


@dataclass(frozen=True)
class Target:
    """A platform."""

    fmi3: str  # folder of its binary in an FMU 3.0
    fmi2: str  # the same in an FMU 2.0
    zig: str  # what ziglang calls it
    suffix: str  # of its shared libraries

    def folder(self, fmi: str) -> str:
        """Folder of its binary under ``binaries``."""
        return self.fmi2 if fmi == "2.0" else self.fmi3


# The one that pythonfmu brings a library for, beside Windows.
LINUX = Target("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so")

# FMI 2.0 has names for 64-bit x86 only; importers of FMI 2.0 on other machines look for those of FMI 3.0.
TARGETS = (
    LINUX,
    Target("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
    Target("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll"),
    Target("x86_64-darwin", "darwin64", "x86_64-macos.11.0", ".dylib"),
    Target("aarch64-darwin", "aarch64-darwin", "aarch64-macos.11.0", ".dylib"),
)

_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}


def this_machine() -> Target:
    """The platform that this process runs on. Raises CompileError for one that is not known."""
    machine = platform.machine().lower()
    name = f"{_MACHINES.get(machine, machine)}-{platform.system().lower()}"
    for target in TARGETS:
        if target.fmi3 == name:
            return target
    raise CompileError(f"no FMU binaries are known for {name}")


def reachable_targets() -> tuple[Target, ...]:
    """Platforms that can be compiled for here: all of them with ziglang, else this one."""
    return TARGETS if find_spec("ziglang") else (this_machine(),)


def compiler(target: Target) -> list[str]:
    """Command of a C compiler for a target: ziglang, or else $CC or the system's for this machine.

    Raises CompileError where there is none.
    """
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", target.zig]
    own = shlex.split(os.environ.get("CC", "")) or [c for c in ("cc", "gcc", "clang") if shutil.which(c)][:1]
    if own and shutil.which(own[0]) and target == this_machine():
        return own
    raise CompileError(f"no C compiler for {target.fmi3}: install one, or ziglang (pip install ziglang)")


def can_compile(target: Target | None = None) -> bool:
    """Whether there is a compiler for a target, by default this machine."""
    try:
        return bool(compiler(target or this_machine()))
    except CompileError:
        return False


def compile_library(
    folder: Path, files: Sequence[str], target: Target, library: Path, *, needs: Sequence[str] = ()
) -> None:
    """Compile C files of a folder into a shared library. Raises CompileError with what the compiler said.

    Parameters
    ----------
    folder : where the files are
    files : their names
    target : the platform
    library : what is made
    needs : files of the folder, shared libraries that it looks for beside itself
    """
    position = [] if "windows" in target.fmi3 else ["-fPIC"]
    mathematics = ["-lm"] if "linux" in target.fmi3 else []
    beside = ["-Wl,--no-as-needed", *needs, "-Wl,-rpath,$ORIGIN", "-ldl"] if needs else []
    command = [*compiler(target), *FLAGS, *position, *files, *beside]
    kept = _kept(folder, command, target)
    with tempfile.TemporaryDirectory(prefix="rigtwin_cc_") as scratch:  # compilers leave more than the library
        if not kept.is_file():
            made = Path(scratch) / library.name
            whole = [*command, "-o", str(made), *mathematics]
            finished = subprocess.run(whole, capture_output=True, text=True, cwd=folder, check=False)
            if finished.returncode:
                raise CompileError(f"the C compiler failed for {target.fmi3}:\n{finished.stderr.strip()}")
            kept = _keep(made, kept)
        library.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(kept, library)


def _kept(folder: Path, command: Sequence[str], target: Target) -> Path:
    """Where a library of these sources and this command is kept from one build to the next."""
    digest = hashlib.sha256(" ".join([*command, *_versions()]).encode())
    for path in sorted(folder.glob("*.[ch]")):
        digest.update(path.name.encode() + path.read_bytes())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "rigtwin" / f"{digest.hexdigest()}{target.suffix}"


def _versions() -> tuple[str, ...]:
    """What the same command may stand for on another machine with the same home folder."""
    if find_spec("ziglang"):
        return (version("ziglang"),)
    said = subprocess.run([*compiler(this_machine()), "--version"], capture_output=True, text=True, check=False).stdout
    return said, *platform.libc_ver()


def _keep(made: Path, kept: Path) -> Path:
    """Put a library there, beside and renamed; where that is not possible, it stays where it is."""
    beside = kept.with_name(f".{kept.name}.{os.getpid()}")
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(made, beside)
        os.replace(beside, kept)
    except OSError:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        return made
    return kept
