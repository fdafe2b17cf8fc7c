"""Commands that are killed: ``python -m tests.kill_commands [--count N]`` kills them at so many random moments.

Each command first runs undisturbed. Then it runs again over its own files, is killed by SIGKILL at a random moment,
and runs once more to its end. What is looked at: no process of a killed command lives on, every file is whole, and
after the next run the same files are there and nothing else, neither beside them nor in the folder for temporary files.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import uuid
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STORED = ROOT / "benchmarks" / "stored_campaigns"
MEASURED = STORED / "ross_pedestals" / "measured"
MARK = "RIGTWIN_TEST_KILLED"
SECONDS_TO_END = 15.0  # in which workers notice that their command has gone

SHORT = ("--lines", "12", "--f-max", "60")
# {made}: what the commands that come before have made; {out}: a folder of its own.
COMMANDS: dict[str, tuple[str, ...]] = {
    "build": ("build", "--out", "{out}", "--tracker", "--monitor"),
    "build_native": ("build", "--out", "{out}", "--native", "--target", "here"),
    "sweep": ("sweep", "{made}/build/RotorRig.fmu", *SHORT, "--out", "{out}/run.csv"),
    "levels": ("sweep", *SHORT, "--effect", "bearing_cubic", "--levels", "1,2", "--out", "{out}/run.h5"),
    "convert": ("convert", "{measured}/run01_rigid_1N.csv", "{out}/run.mat", "--set", "support=rigid"),
    "report": ("report", "{measured}", "--out", "{out}/page.html"),
    "compare": ("compare", "{measured}", "{measured}", "--out", "{out}/compare.html"),
    "diagnose": ("diagnose", "{measured}", "--out", "{out}"),
    "predict": ("predict", "{made}/diagnose/diagnosis.json", "{held_out}", "--out", "{out}"),
    "check": ("check", "{made}/build/RotorRig.fmu", "--junit", "{out}/report.xml"),
    "modes": ("modes", "--out", "{out}/modes.png"),
    "campbell": ("campbell", "--out", "{out}/campbell.svg"),
    "train": ("train", "--rigs", "16", "--calibration-rigs", "16", "--out", "{out}"),
    "blind": ("blind", "W3", "--count", "1", "--out", "{out}"),
}


def command(name: str, folder: Path) -> list[str]:
    """The whole command line; its files go to ``folder / name``."""
    places = {"made": folder, "out": folder / name, "measured": MEASURED, "held_out": MEASURED.with_name("held_out")}
    return [sys.executable, "-m", "rigtwin", *(word.format_map(places) for word in COMMANDS[name])]


def environment(folder: Path, mark: str) -> dict[str, str]:
    """Folders of its own for what is temporary and for the list of FMUs; ``mark`` is how its processes are known."""
    return os.environ | {"TMPDIR": str(folder / "temporary"), "XDG_STATE_HOME": str(folder / "state"), MARK: mark}


def run(name: str, folder: Path) -> float:
    """Run a command to its end; the seconds that it took. Raises AssertionError where it fails."""
    (folder / name).mkdir(exist_ok=True)
    began = time.monotonic()
    finished = subprocess.run(
        command(name, folder), env=environment(folder, ""), capture_output=True, text=True, check=False
    )
    assert finished.returncode == 0, f"exit code {finished.returncode}: {finished.stderr.strip()[-500:]}"
    return time.monotonic() - began


def killed(name: str, folder: Path, after: float) -> None:
    """Kill a command after so many seconds. Raises AssertionError where a process of it lives on."""
    mark = uuid.uuid4().hex
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command(name, folder), env=environment(folder, mark), **quiet) as process:
        time.sleep(after)
        process.send_signal(signal.SIGKILL)
    until = time.monotonic() + SECONDS_TO_END
    while (living := list(processes(mark))) and time.monotonic() < until:
        time.sleep(0.1)
    assert not living, f"{len(living)} processes live on: {living}"


def processes(mark: str) -> Iterator[str]:
    """Command lines of the processes that have the mark."""
    for each in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if f"{MARK}={mark}".encode() in (each / "environ").read_bytes():
                yield (each / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")


def files(folder: Path) -> dict[str, bytes]:
    """Files by name, but for those of folders in which one is being made."""
    found = {path.relative_to(folder): path for path in sorted(folder.rglob("*")) if path.is_file()}
    seen = (name for name in found if not any(part.startswith(".") for part in name.parts))
    return {str(name): found[name].read_bytes() for name in seen}


def _archive_is_whole(content: bytes) -> bool:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return archive.testzip() is None


WHOLE: dict[str, Callable[[bytes], bool]] = {
    ".html": lambda content: content.rstrip().endswith(b"</html>"),
    ".svg": lambda content: content.rstrip().endswith(b"</svg>"),
    ".xml": lambda content: content.rstrip().endswith(b">"),
    ".png": lambda content: b"IEND" in content[-12:],
    ".json": lambda content: json.loads(content) is not None,
    ".fmu": _archive_is_whole,
    ".npz": _archive_is_whole,
    ".csv": lambda content: content.endswith(b"\n"),
}


def check_whole(now: dict[str, bytes], before: dict[str, bytes]) -> None:
    """Raises AssertionError where a file is lost or half written."""
    lost = before.keys() - now.keys()
    assert not lost, f"lost: {sorted(lost)}"
    for name, content in now.items():
        if content != before.get(name):
            whole = WHOLE.get(Path(name).suffix, bool)
            try:
                assert whole(content), f"half written: {name}"
            except (ValueError, zipfile.BadZipFile) as error:
                raise AssertionError(f"half written: {name} ({error})") from error


def check_tidy(name: str, folder: Path, before: dict[str, bytes]) -> None:
    """Raises AssertionError where something is left beside the files or in the folder for temporary files."""
    more = files(folder / name).keys() - before.keys()
    hidden = [str(path) for path in (folder / name).rglob(".*rigtwin_*")]
    left = [path.name for path in (folder / "temporary").iterdir()]
    behind = [*sorted(more), *hidden, *left]
    assert not behind, f"left behind: {', '.join(behind)}"


def main(arguments: list[str] | None = None) -> int:
    """Kill them, print what was found; returns 1 where anything was."""
    parser = argparse.ArgumentParser(description="Kill commands at random moments.")
    parser.add_argument("commands", nargs="*", help=f"of {', '.join(COMMANDS)}; default all")
    parser.add_argument("--count", type=int, default=100, help="kills of all commands together")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    rng, found, names = random.Random(options.seed), 0, options.commands or list(COMMANDS)
    with tempfile.TemporaryDirectory(prefix="kills_") as place:
        folder = Path(place)
        (folder / "temporary").mkdir()
        took = {name: run(name, folder) for name in COMMANDS if name in (*names, "build", "diagnose")}
        for number in range(options.count):
            name = names[number % len(names)]
            before, after = files(folder / name), rng.uniform(0.0, took[name])
            try:
                killed(name, folder, after)
                check_whole(files(folder / name), before)
                run(name, folder)
                check_whole(files(folder / name), before)
                check_tidy(name, folder, before)
            except AssertionError as error:
                found += 1
                print(f"{number + 1}. {name}, killed after {after:.2f} of {took[name]:.1f} s: {error}", flush=True)
        longest = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in took.items())
        print(f"{options.count} kills, {found} with something lost, half written or left behind ({longest})")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
