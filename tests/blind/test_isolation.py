"""The generator is a second implementation: nothing of the diagnosis' model gets in."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOM = ROOT / "blind"
FORBIDDEN = ("fmpy", "pythonfmu")
ALLOWED = {"numpy", "scipy"} | set(sys.stdlib_module_names)


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno} is relative"
            names.add(node.module or "")
    return names


def test_the_room_imports_itself_numpy_and_scipy_only():
    for path in sorted(ROOM.rglob("*.py")):
        for name in imported(path):
            assert name.startswith("rigtwin.blind") or name.split(".")[0] in ALLOWED, f"{path.name} imports {name}"


def test_running_it_loads_nothing_of_the_diagnosis():
    files = sorted(path for path in ROOM.rglob("*.py") if path.stem != "__init__")
    modules = ", ".join(f"rigtwin.blind.{path.parent.name}.{path.stem}" for path in files)
    assert files
    code = f"import sys, {modules}; print(*sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert not {m for m in loaded if m.split(".")[0] in FORBIDDEN}
    own = {m for m in loaded if m.split(".")[0] == "rigtwin"}
    assert own == {"rigtwin", "rigtwin.blind"} | {m for m in own if m.startswith("rigtwin.blind.")}
