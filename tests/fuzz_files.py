"""Damaged files of every format that rigtwin reads.

    python -m tests.fuzz_files [--count N] [--minutes M] [FORMAT ...]

Input k of a format is the same on every machine. The files are read in a process of their own: what ends that process
is a crash, what takes longer than 30 s a hang, and what is said in another way than by a sentence a traceback. HDF5 and
MATLAB files go on being decoded in a child of that process, as always; here it is forked, which takes a tenth of the
time. Failing inputs are kept in build/fuzz.
"""

from __future__ import annotations

import argparse
import io
import multiprocessing
import os
import random
import re
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from collections.abc import Callable
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build" / "fuzz"
CAMPAIGN = ROOT / "benchmarks" / "stored_campaigns" / "ross_pedestals" / "measured" / "campaign.toml"

LONGEST = 30.0  # seconds for one input
MEMORY = 1 << 30  # beyond what Python and the libraries take

# What numbers and words of a text are replaced by.
NUMBERS = [b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1e308", b"1e-320", b"4294967298", b"9" * 400, b"9" * 5000]
NUMBERS += [b""]
WORDS = [b"[", b"]", b"{", b"}", b"[[", b'"', b"'", b"=", b",", b";", b"\t", b"\n", b"\r", b"\0", b"\xff", b"\xc3\xa9"]
WORDS += [b"-1\n"]


@dataclass(frozen=True)
class Format:
    """One kind of file: good ones, and what reads them."""

    suffix: str
    seeds: list[bytes]
    read: Callable[[Path], Any]
    text: bool = True


# -- mutations -------------------------------------------------------------------------------------


def mutated(form: Format, name: str, number: int) -> bytes:
    """Input ``number`` of a format."""
    rng = random.Random(f"{name} {number}")
    content = rng.choice(form.seeds)
    if name == "fmu":
        return mutated_archive(content, rng)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        content = rng.choice(TEXT_CHANGES if form.text and rng.random() < 0.7 else CHANGES)(content, rng)
    return content


def mutated_archive(content: bytes, rng: random.Random) -> bytes:
    """Half of them have a wrong byte somewhere, the others a wrong member whose sum is right."""
    if rng.random() < 0.5:
        return rng.choice(CHANGES)(content, rng)
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as whole, zipfile.ZipFile(made, "w") as copy:
        chosen = rng.choice(["modelDescription.xml", "resources/manifest.json", "resources/estimator.onnx"])
        for name in whole.namelist():
            member = whole.read(name)
            if name == chosen:
                member = rng.choice(CHANGES if name.endswith("onnx") else TEXT_CHANGES + CHANGES)(member, rng)
            copy.writestr(name, member)
    return made.getvalue()


def _flip(content: bytes, rng: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        if changed:
            changed[rng.randrange(len(changed))] = rng.choice((rng.randrange(256), 0, 255, 127, 128))
    return bytes(changed)


def _cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _slice(content: bytes, rng: random.Random) -> tuple[int, int]:
    begin = rng.randrange(len(content) + 1)
    return begin, min(len(content), begin + rng.choice((1, 4, 16, 64, 500)))


def _remove(content: bytes, rng: random.Random) -> bytes:
    begin, end = _slice(content, rng)
    return content[:begin] + content[end:]


def _repeat(content: bytes, rng: random.Random) -> bytes:
    begin, end = _slice(content, rng)
    return content[:end] + content[begin:end] * rng.choice((1, 2, 50)) + content[end:]


def _number(content: bytes, rng: random.Random) -> bytes:
    places = [match.span() for match in re.finditer(rb"[-+]?\d[\d.eE+-]*", content)]
    if not places:
        return _flip(content, rng)
    begin, end = rng.choice(places)
    return content[:begin] + rng.choice(NUMBERS) + content[end:]


def _word(content: bytes, rng: random.Random) -> bytes:
    begin, end = _slice(content, rng)
    return content[:begin] + rng.choice(WORDS) * rng.choice((1, 1, 2, 5000)) + content[rng.choice((begin, end)) :]


def _line(content: bytes, rng: random.Random) -> bytes:
    lines = content.split(b"\n")
    here, there = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[here] = lines[there] if rng.random() < 0.5 else lines[here] + lines[there]
    return b"\n".join(lines)


CHANGES = (_flip, _flip, _cut, _remove, _repeat)
TEXT_CHANGES = (_number, _number, _word, _line, _flip, _cut, _remove, _repeat)


# -- formats ---------------------------------------------------------------------------------------


def formats(scratch: Path) -> dict[str, Format]:
    """Every format, with files that are read."""
    from rigtwin.api.diagnoses import read_diagnosis as load_diagnosis
    from rigtwin.api.fmus import _network, manifest
    from rigtwin.estimator.runtime import shipped_model
    from rigtwin.fmu_src.build import build_estimator_fmu
    from rigtwin.rotor.geometry.rig import load_rig
    from rigtwin.sim.archive import describe, unpack
    from rigtwin.sim.campaign_folder import load_campaign
    from rigtwin.sim.formats.run_file import read_run
    from tests.rigtwin.test_hostile_input import RIG, STEEL

    def run(path: Path) -> None:
        averages = {"averages": 5} if b"coherence" in path.read_bytes() else {}
        read_run(path, support="rigid", **averages)

    def campaign(path: Path) -> None:
        folder = path.parent / "campaign"
        folder.mkdir(exist_ok=True)
        for number in range(1, 9):
            (folder / f"run{number:02}.csv").write_bytes(seeds["csv"][0])
        (folder / "campaign.toml").write_bytes(path.read_bytes())
        load_campaign(folder)

    def fmu(path: Path) -> None:
        manifest(path)
        describe(path)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            unpack(path, Path(folder))

    seeds = {name: _run_files(scratch, name) for name in ("csv", "uff", "h5", "mat")}
    ascii_uff = [_as_ascii_uff(scratch)]
    estimator = build_estimator_fmu(scratch).read_bytes()
    stored = CAMPAIGN.read_bytes().replace(b"_rigid_1N", b"").replace(b"_bearing_1N", b"")
    toml = [stored, b'title = "a"\nrig = "nit-rourkela"\n[nominal]\nfrequency_drift = 1e-4\n' + PEAKS]
    shipped = [path.read_bytes() for path in sorted((ROOT / "rotor/rigs").glob("*.toml"))]
    every = {  # the slow ones last, which then get the time that the others leave
        "csv": Format(".csv", [*seeds["csv"], *CSV], run),
        "uff58": Format(".uff", ascii_uff, run),
        "uff58b": Format(".uff", seeds["uff"], run, text=False),
        "campaign": Format(".toml", toml, campaign),
        "rig": Format(".toml", [RIG.format_map(STEEL).encode(), *shipped], load_rig),
        "diagnosis": Format(".json", [_diagnosis()], load_diagnosis),
        "fmu": Format(".fmu", [estimator], fmu, text=False),
        "onnx": Format(".onnx", [shipped_model().read_bytes()], lambda path: _network(path, path), text=False),
        "hdf5": Format(".h5", seeds["h5"], run, text=False),
        "mat5": Format(".mat", seeds["mat"], run, text=False),
        "mat73": Format(".mat", [_as_matlab_73(scratch)], run, text=False),
    }
    for name, form in every.items():
        for seed in form.seeds:  # raises where one is not read
            (whole := scratch / f"{name}{form.suffix}").write_bytes(seed)
            form.read(whole)
    return every


PEAKS = b'[[peaks]]\nsupport = "rigid"\nfrequencies_Hz = [95.0, 320.0]\nstd_Hz = [1.5, 3.0]\n'
CSV = [
    b"sep=;\nfrequency_Hz;node2_abs;node2_deg\n10,5;1,0;3,0\n11,5;2,0;4,0\n",
    b"frequency_Hz,force_N,node2_dB,node2_deg,node2_coherence\n10,1,-3,10,0.9\n12,1,-4,11,0.8\n13,1,-5,12,0.7\n",
]


def _run() -> Any:
    from rigtwin.sim.campaign import Channel, Run

    rng = np.random.default_rng(1)
    values = [rng.normal(size=(6, 3)) + 1j * rng.normal(size=(6, 3)) for _ in range(2)]
    channels = (Channel(2), Channel(4), Channel(2, "z"))
    frequency = np.array([10.0, 11.5, 13.0, 20.0, 21.0, 30.0])
    return Run(frequency, values[0], channels, "rigid", std=np.abs(values[0]) / 10, harmonics={3: values[1]}, name="a")


def _run_files(scratch: Path, suffix: str) -> list[bytes]:
    from rigtwin.sim.formats.run_file import write_run

    write_run(_run(), scratch / f"run.{suffix}")
    return [(scratch / f"run.{suffix}").read_bytes()]


def _as_ascii_uff(scratch: Path) -> bytes:
    import pyuff

    sets = [each for each in pyuff.UFF(str(scratch / "run.uff")).read_sets() if each["type"] == 58]
    for each in sets:
        each["binary"] = 0
        pyuff.UFF(str(scratch / "ascii.uff")).write_sets(each, mode="add")
    return (scratch / "ascii.uff").read_bytes()


def _as_matlab_73(scratch: Path) -> bytes:
    """What MATLAB 7.3 writes: HDF5 behind 512 bytes, complex numbers as pairs, axes reversed."""
    import h5py

    run, path = _run(), scratch / "v73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        pair = np.empty(run.H.T.shape, dtype=[("real", "f8"), ("imag", "f8")])
        pair["real"], pair["imag"] = run.H.T.real, run.H.T.imag
        file["H"], file["frequency_Hz"], file["node"] = pair, run.frequency_hz[:, None], np.array([[2.0, 4.0, 5.0]]).T
    content = bytearray(path.read_bytes())
    content[:12] = b"MATLAB 7.3 M"
    return bytes(content)


def _diagnosis() -> bytes:
    from rigtwin.gap.document import Cause, Diagnosis, Estimate, Location, Where

    cause = Cause(
        ("attached_mass",), Location("node", node=4), 0.9, {"mass": Estimate(0.08, 0.01, "kg")}, Estimate(1e6, 1e3)
    )
    nominal = {"k_b": Estimate(1e7, 1e5, "N/m"), "gap": 0.1}
    return Diagnosis("t", "nit-rourkela", "cause", "s", nominal, Where(), (cause,)).to_json().encode()


# -- reading ---------------------------------------------------------------------------------------


@dataclass
class Tally:
    """What became of the inputs of one format."""

    inputs: int = 0
    read: int = 0
    refused: int = 0
    unnamed: int = 0  # refusals that do not name the file
    tracebacks: int = 0
    crashes: int = 0
    hangs: int = 0
    megabytes: float = 0.0
    seconds: float = 0.0
    first: dict[str, str] = field(default_factory=dict)  # of each kind of failure


def fuzz(name: str, form: Format, numbers: range, deadline: float, scratch: Path) -> Tally:
    """Read inputs until there are enough or the time is over."""
    tally, begin = Tally(), time.monotonic()
    context = multiprocessing.get_context("fork")
    shared = context.Array("q", [numbers.start, 0, 0, 0], lock=False)  # next input, read, refused, unnamed
    while shared[0] < numbers.stop and time.monotonic() < deadline:
        receiver, sender = context.Pipe(duplex=False)
        worker = context.Process(target=_work, args=(name, form, numbers.stop, deadline, scratch, shared, sender))
        worker.start()
        sender.close()
        ended = _watch(worker, receiver, shared, tally, name, form)
        if ended != "done":
            setattr(tally, ended, getattr(tally, ended) + 1)
            _keep(tally, ended, name, form, shared[0])
            shared[0] += 1
    tally.inputs, tally.read, tally.refused, tally.unnamed = shared[0] - numbers.start, *shared[1:]
    tally.seconds = time.monotonic() - begin
    return tally


def _watch(worker: Any, receiver: Any, shared: Any, tally: Tally, name: str, form: Format) -> str:
    """How a worker ended: done, in a crash, or in a hang."""
    at, since = shared[0], time.monotonic()
    while True:
        if receiver.poll(0.2):
            try:
                kind, *about = receiver.recv()
            except EOFError:
                worker.join()
                return "done" if worker.exitcode == 0 else "crashes"
            if kind == "memory":
                tally.megabytes = max(tally.megabytes, about[0])
            else:
                setattr(tally, kind, getattr(tally, kind) + 1)
                _keep(tally, kind, name, form, *about)
        if shared[0] != at:
            at, since = shared[0], time.monotonic()
        elif time.monotonic() - since > LONGEST:
            worker.kill()
            worker.join()
            return "hangs"


def _keep(tally: Tally, kind: str, name: str, form: Format, number: int, words: str = "") -> None:
    tally.first.setdefault(kind, f"input {number}: {words}".strip())
    KEPT.mkdir(parents=True, exist_ok=True)
    (KEPT / f"{name}-{number}-{kind}{form.suffix}").write_bytes(mutated(form, name, number))


def _work(name: str, form: Format, count: int, deadline: float, scratch: Path, shared: Any, sender: Any) -> None:
    from rigtwin.errors import UserError
    from rigtwin.gap.document import DocumentError
    from rigtwin.rotor.geometry.rig import RigError
    from rigtwin.sim.campaign import MeasurementError
    from rigtwin.sim.formats import in_child
    from rigtwin.sim.session import FmuError

    in_child.subprocess = _Forking  # type: ignore[assignment] - a process from scratch takes ten times as long
    with open("/proc/self/statm", encoding="ascii") as statm:
        used = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    path = scratch / f"{name}{form.suffix}"
    with open(os.devnull, "w", encoding="utf-8") as silent, redirect_stderr(silent):
        while shared[0] < count and time.monotonic() < deadline:
            path.write_bytes(mutated(form, name, shared[0]))
            try:
                form.read(path)
                shared[1] += 1
            except (MeasurementError, RigError, DocumentError, FmuError, UserError) as error:
                shared[2] += 1
                shared[3] += path.stem not in str(error)
            except BaseException:
                sender.send(("tracebacks", shared[0], traceback.format_exc(limit=-3)))
            shared[0] += 1
    used_most = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    sender.send(("memory", max(used_most) / 1024))
    os._exit(0)


class _Forking:
    """Stands for the module subprocess where ``in_child`` uses it: the decoder runs in a fork."""

    TimeoutExpired = subprocess.TimeoutExpired

    @staticmethod
    def run(command: list[str], timeout: float, **_: Any) -> subprocess.CompletedProcess:
        from rigtwin.sim.formats import decoder

        with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
            child = os.fork()
            if child == 0:
                _decode(decoder.main, command, output.fileno(), errors.fileno())
            pidfd = os.pidfd_open(child)
            ready, _, _ = select.select([pidfd], [], [], timeout)
            os.close(pidfd)
            if not ready:
                os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            if not ready:
                raise subprocess.TimeoutExpired(command, timeout)
            said = [os.pread(file.fileno(), os.fstat(file.fileno()).st_size, 0) for file in (output, errors)]
        return subprocess.CompletedProcess(command, os.waitstatus_to_exitcode(status), *said)


def _decode(program: Callable[[str, Path], None], command: list[str], output: int, errors: int) -> None:
    """Run the decoder in this process and end it."""
    sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(file, "w", closefd=False)) for file in (output, errors))
    code = 1
    try:
        program(command[-2], Path(command[-1]))
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


# -- the command -----------------------------------------------------------------------------------


def main(arguments: list[str] | None = None) -> int:
    """Fuzz all formats, print the table; returns 1 where anything failed."""
    parser = argparse.ArgumentParser(description="Read damaged files of every format.")
    parser.add_argument("formats", nargs="*", help="default all")
    parser.add_argument("--count", type=int, default=10_000, help="inputs of each format")
    parser.add_argument("--start", type=int, default=0, help="number of the first of them")
    parser.add_argument("--minutes", type=float, default=60.0, help="for all formats together")
    options = parser.parse_args(arguments)
    failed, numbers = False, range(options.start, options.start + options.count)
    with tempfile.TemporaryDirectory(prefix="fuzz_") as folder:
        every = formats(Path(folder))
        chosen = {name: every[name] for name in options.formats or every}
        end = time.monotonic() + 60 * options.minutes
        print("| format | inputs | read | refused | tracebacks | crashes | hangs | memory, MB | seconds |")
        print("|---|---|---|---|---|---|---|---|---|", flush=True)
        for place, (name, form) in enumerate(chosen.items()):
            share = (end - time.monotonic()) / (len(chosen) - place)
            t = fuzz(name, form, numbers, time.monotonic() + share, Path(folder))
            counts = (t.inputs, t.read, t.refused, t.tracebacks, t.crashes, t.hangs)
            print(f"| {name} | {' | '.join(map(str, counts))} | {t.megabytes:.0f} | {t.seconds:.0f} |", flush=True)
            for kind, words in t.first.items():
                print(f"{name}: {kind}: {words}", file=sys.stderr)
            if t.unnamed:
                print(f"{name}: {t.unnamed} refusals do not name the file", file=sys.stderr)
            failed |= bool(t.tracebacks + t.crashes + t.hangs + t.unnamed)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
