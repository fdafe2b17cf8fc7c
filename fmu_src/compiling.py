"""C sources to shared libraries, for this machine and, with ziglang, for every other."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from rigtwin.scratch import replacing, scratch_folder

logger = logging.getLogger(__name__)

# Of each hash in the name of a kept library: as many hexadecimal digits.
_DIGITS = 32

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


# FMI 2.0 has names for 64-bit x86 only; importers of FMI 2.0 on other machines look for those of FMI 3.0.
TARGETS = (
    Target("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so"),
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


def targets_named(names: Sequence[str]) -> tuple[Target, ...]:
    """Platforms by their names in FMI 3.0; "here" is this machine's. Raises CompileError for others."""
    known = {target.fmi3: target for target in TARGETS}
    here = {"here": this_machine()} if "here" in names else {}
    for name in names:
        if name not in known | here:
            raise CompileError(f"there is no platform {name}; there are here, {', '.join(known)}")
        if name not in here and (known | here)[name] not in reachable_targets():
            raise CompileError(f"{name} cannot be compiled for here without ziglang: pip install ziglang")
    return tuple(dict.fromkeys((known | here)[name] for name in names))


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


def can_compile() -> bool:
    """Whether there is a compiler for this machine."""
    try:
        return bool(compiler(this_machine()))
    except CompileError:
        return False


def compile_library(folder: Path, files: Sequence[str], target: Target, library: Path) -> None:
    """Compile C files of a folder into a shared library. Raises CompileError with what the compiler said.

    Parameters
    ----------
    folder : where the files are
    files : their names
    target : the platform
    library : what is made
    """
    position = [] if "windows" in target.fmi3 else ["-fPIC"]
    mathematics = ["-lm"] if "linux" in target.fmi3 else []
    command = [*compiler(target), *FLAGS, *position, *files]
    kept = _Kept.of(folder, command, target)
    content = kept.read()
    if content is None:
        with scratch_folder("cc_") as scratch:  # compilers leave more than the library
            made = scratch / library.name
            whole, own = [*command, "-o", str(made), *mathematics], os.environ | {"TMPDIR": str(scratch)}
            finished = subprocess.run(whole, capture_output=True, text=True, cwd=folder, check=False, env=own)
            if finished.returncode:
                raise CompileError(f"the C compiler failed for {target.fmi3}:\n{finished.stderr.strip()}")
            content = made.read_bytes()
        kept.write(content)
    library.parent.mkdir(parents=True, exist_ok=True)
    library.write_bytes(content)
    library.chmod(0o755)


@dataclass(frozen=True)
class _Kept:
    """A library that is kept from one build to the next, in a file whose name says the hash of what it holds."""

    cache: Path | None  # None: nothing is kept
    key: str  # of sources and command
    suffix: str

    @classmethod
    def of(cls, folder: Path, command: Sequence[str], target: Target) -> _Kept:
        """That of the sources in a folder and of a command that compiles them."""
        digest = hashlib.sha256(" ".join([*command, *_versions()]).encode())
        for path in sorted(folder.glob("*.[ch]")):
            digest.update(path.name.encode() + path.read_bytes())
        return cls(compile_cache(), digest.hexdigest()[:_DIGITS], target.suffix)

    def read(self) -> bytes | None:
        """What is kept; None where nothing is, or where it is damaged, which is then removed."""
        for path in self.cache.glob(f"{self.key}-*{self.suffix}") if self.cache else ():
            try:
                content = path.read_bytes()
            except OSError as error:
                logger.warning("%s cannot be read (%s); it is compiled again", path, error.strerror)
                continue
            if path.name == self._name(content):
                return content
            logger.warning("%s is damaged and is compiled again", path)
            with suppress(OSError):
                path.unlink()
        return None

    def write(self, content: bytes) -> None:
        """Keep a library, where that is possible."""
        if self.cache is None:
            return
        with suppress(OSError):
            self.cache.mkdir(parents=True, exist_ok=True)
            with replacing(self.cache / self._name(content)) as beside:
                beside.write_bytes(content)

    def _name(self, content: bytes) -> str:
        return f"{self.key}-{hashlib.sha256(content).hexdigest()[:_DIGITS]}{self.suffix}"


def compile_cache() -> Path | None:
    """Folder of what has been compiled, which may be deleted at any time; None where the user has no home folder."""
    named = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(named) if named else Path.home() / ".cache") / "rigtwin"
    except RuntimeError:
        return None


def _versions() -> tuple[str, ...]:
    """What the same command may stand for on another machine with the same home folder."""
    if find_spec("ziglang"):
        return (version("ziglang"),)
    said = subprocess.run([*compiler(this_machine()), "--version"], capture_output=True, text=True, check=False).stdout
    return said, *platform.libc_ver()
