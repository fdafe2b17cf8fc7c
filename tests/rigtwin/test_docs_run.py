"""Every code block of the pages runs: Python, shell, sessions with their output, rig files, campaigns, data.

A fence says what its block is. One that cannot run has a line ``<!-- not run: REASON -->`` above it.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer

from rigtwin.cli import app
from rigtwin.sim.campaign import Campaign
from rigtwin.sim.campaign_folder import save_campaign
from rigtwin.sim.formats import read_run, write_run

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    str(page.relative_to(ROOT)): page
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "examples").rglob("*.md"))
}

# Blocks that hold no code: output, trees of folders, and what Sphinx reads.
NO_CODE = {"text", "{toctree}", "{eval-rst}", "{figure}"}
CODE = {"python", "sh", "console", "toml", "csv", "matlab", "{code-cell}"}

# Pages whose blocks take a minute or more, most of it in whole diagnoses.
LONG = {
    "README.md",
    "docs/command-line.md",
    "docs/compare.md",
    "docs/diagnosis.md",
    "docs/modes.md",
    "docs/monitor.md",
    "docs/reduce.md",
    "docs/tracker.md",
    "docs/tutorial.md",
}

_FENCE = re.compile(r"^```(?P<kind>\S*)[^\n]*\n(?P<code>.*?)^```$", re.MULTILINE | re.DOTALL)
_NOT_RUN = re.compile(r"<!-- not run: (?P<reason>.{8,}) -->\n$")


@dataclass(frozen=True)
class Block:
    """A code block of a page."""

    kind: str
    code: str
    line: int
    not_run: str  # the reason; empty: it runs


def blocks_of(text: str) -> list[Block]:
    """All of a page."""
    found = []
    for fence in _FENCE.finditer(text):
        mark = _NOT_RUN.search(text[: fence.start()])
        line = text[: fence.start()].count("\n") + 1
        found.append(Block(fence["kind"], fence["code"], line, mark["reason"] if mark else ""))
    return found


BLOCKS = {name: blocks_of(page.read_text(encoding="utf-8")) for name, page in PAGES.items()}
WITH_CODE = [name for name, blocks in BLOCKS.items() if any(b.kind in CODE and not b.not_run for b in blocks)]


@pytest.mark.parametrize("name", list(PAGES))
def test_every_fence_says_what_its_block_is(name):
    for block in BLOCKS[name]:
        where = f"{name}:{block.line}"
        assert block.kind in CODE | NO_CODE, f"{where}: a fence without a known kind"
        if block.kind == "text":
            assert not re.search(r"^(\$ |rigtwin |make )", block.code, re.MULTILINE), (
                f"{where}: commands in a text block"
            )


def test_most_blocks_run():
    code = [block for blocks in BLOCKS.values() for block in blocks if block.kind in CODE]
    assert len(code) > 50
    assert sum(bool(block.not_run) for block in code) < 0.2 * len(code)


# -- where they run --------------------------------------------------------------------------------------


@pytest.fixture
def workshop(tmp_path, monkeypatch, rotor_fmu, estimator_fmu, swept) -> Path:
    """A folder like a clone after ``make demo``, with the files that pages take for granted."""
    for name in ("examples", "benchmarks", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "dist").mkdir()
    for fmu in (rotor_fmu, estimator_fmu):
        shutil.copy(fmu, tmp_path / "dist" / fmu.name)
    runs = read_run(swept.rigid, support="rigid"), read_run(swept.bearing, support="bearing")
    for folder in ("my-campaign", "runs/demo/campaign"):
        save_campaign(Campaign("two runs", "nit-rourkela", runs), tmp_path / folder)
    write_run(runs[1], tmp_path / "run02.uff")
    write_run(runs[1], tmp_path / "analyser.uff")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def shell(command: str) -> subprocess.CompletedProcess[str]:
    """Run by bash, both streams in one, in the order in which they are written."""
    settings = {**os.environ, "PYTHONUNBUFFERED": "1"}
    return subprocess.run(
        ["bash", "-e", "-c", command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=settings
    )


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long if n in LONG else ()) for n in WITH_CODE])
def test_the_blocks_of_a_page_run_one_after_the_other(name, workshop):
    names: dict[str, object] = {}
    for block in BLOCKS[name]:
        if block.kind in CODE and not block.not_run:
            try:
                RUN[block.kind](block.code, names)
            except Exception as error:
                error.add_note(f"{name}, line {block.line}")
                raise


def run_python(code: str, names: dict[str, object]) -> None:
    """A block, or a cell of a notebook with its options."""
    options = re.match(r"(:[^\n]*\n)+", code)
    code = code[options.end() :] if options else code
    exec(compile(code, "<page>", "exec"), names)


def run_shell(code: str, _names: dict[str, object]) -> None:
    """All commands of a block."""
    done = shell(code)
    assert done.returncode == 0, done.stdout


def run_console(code: str, _names: dict[str, object]) -> None:
    """A session: each command after ``$`` gives the lines beneath it, but for their numbers; "..." is anything."""
    for part in re.split(r"^\$ ", code, flags=re.MULTILINE)[1:]:
        command, _, shown = part.partition("\n")
        done = shell(command)
        assert done.returncode in ((0, 2, 3) if shown.strip() else (0,)), done.stdout
        printed = [in_words(line) for line in done.stdout.splitlines()]
        for line in shown.splitlines():
            words = in_words(line)
            if words and line not in ("...", "…"):
                assert words in printed, f"$ {command}\nshows: {line}\nprints:\n{done.stdout}"


def in_words(line: str) -> str:
    """A line without its numbers, signs and rules of tables, whose widths depend on the numbers.

    >>> in_words(" 2   323.99 ± 0.08   0.1 ")
    '# # #'
    """
    line = re.sub(r"\(?[−+-]?\d[\d.,]*(e[+-]?\d+)?( ± [\d.]+)?\)?", "#", line)
    return " ".join(re.sub(r"[─│]+", "", line).split())


def run_toml(code: str, _names: dict[str, object]) -> None:
    """Valid TOML; the tests of rig files and campaigns check the keys."""
    assert tomllib.loads(code)


def run_csv(code: str, _names: dict[str, object]) -> None:
    """A data file that can be read."""
    Path("page.csv").write_text(code, encoding="utf-8")
    assert len(read_run("page.csv", support="rigid").channels) > 0


RUN = {
    "python": run_python,
    "{code-cell}": run_python,
    "sh": run_shell,
    "console": run_console,
    "toml": run_toml,
    "csv": run_csv,
}


# -- commands in sentences -------------------------------------------------------------------------------


COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]
TARGETS = set(re.findall(r"^([\w/.-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def inline_commands(text: str) -> list[str]:
    """What stands in single backquotes and begins like a command."""
    return re.findall(r"(?<!`)`((?:rigtwin|make|python -m) [a-z][^`]*)`(?!`)", _FENCE.sub("", text))


@pytest.mark.parametrize("name", list(PAGES))
def test_commands_in_sentences_exist_with_their_options(name):
    for command in inline_commands(PAGES[name].read_text(encoding="utf-8")):
        program, first, *others = shlex.split(command.replace("…", ""), comments=True)
        if "=" in first:  # a line of a data file that rigtwin wrote
            continue
        if program == "make":
            assert first in TARGETS, command
        elif program == "rigtwin":
            assert first in COMMANDS, command
            options = {option for parameter in COMMANDS[first].params for option in parameter.opts} | {"--help"}
            assert {word for word in others if word.startswith("--")} <= options, command


def test_the_checks_see_what_is_wrong():
    """A guard that sees nothing guards nothing."""
    assert inline_commands("Say `rigtwin sweep --suport rigid` or `make tea`.") == [
        "rigtwin sweep --suport rigid", "make tea",
    ]  # fmt: skip
    (block,) = blocks_of("<!-- not run: it needs a cluster -->\n```sh\nrigtwin train\n```\n")
    assert (block.kind, block.not_run) == ("sh", "it needs a cluster")
    with pytest.raises(AssertionError, match="shows: no such line"):
        run_console("$ echo one line\nno such line\n", {})
    run_console("$ echo 3.25 MN/m\n7.1 MN/m\n", {})
