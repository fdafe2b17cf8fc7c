"""Who may import whom (docs of the design: the rooms and their arrows), checked on the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Each room may import itself and what stands here. A dotted entry opens one module, not the room.
MAY_IMPORT = {
    "rotor": (),
    "sim": ("rotor",),
    "estimator": ("rotor", "sim"),
    "gap": ("rotor", "sim"),
    "fmu_src": ("rotor", "rigtwin.estimator.runtime"),
    "build_laws": ("rigtwin.rotor.model.force_laws",),
    "build_fmu": ("fmu_src", "rotor", "rigtwin.estimator.runtime"),  # stages what fmu_src runs on
    "rigtwin": ("rotor", "sim", "estimator", "gap", "fmu_src", "build_fmu"),
}
ROTOR_MAY_USE = {"numpy", "scipy", "pydantic", "rotor"} | set(sys.stdlib_module_names)

# What merely importing a package must not load: FMU tools, neural networks, plots.
HEAVY = {"fmpy", "pythonfmu", "torch", "onnx", "onnxruntime", "plotly", "matplotlib", "sympy"}
LIGHT_PACKAGES = {
    "rotor": HEAVY,
    "rigtwin.estimator.runtime": HEAVY - {"onnxruntime"},
    "sim": HEAVY - {"fmpy"},
    "rigtwin": HEAVY,
}


def sources(room: str) -> list[Path]:
    """Python files of a room; a room may be a package or a single module."""
    single = ROOT / f"{room}.py"
    return [single] if single.exists() else sorted((ROOT / room).rglob("*.py"))


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imports(tree: ast.Module, package: str) -> Iterator[tuple[int, str]]:
    """(line, dotted module) of every import, wherever in the file; relative ones made absolute."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            yield from ((node.lineno, ".".join([*base, *filter(None, [node.module]), a.name])) for a in node.names)


def is_inside(module: str, room: str) -> bool:
    return module == room or module.startswith(room + ".")


def forbidden_imports(room: str) -> list[str]:
    """'sim/x.py:3 imports fmu_src.slave' for every arrow that the design does not draw."""
    allowed = (room, *MAY_IMPORT[room])
    found = []
    for path in sources(room):
        package = module_name(path if path.name == "__init__.py" else path.parent / "__init__.py")
        for line, module in imports(ast.parse(path.read_text(encoding="utf-8")), package):
            crosses = any(is_inside(module, other) for other in MAY_IMPORT)
            if crosses and not any(is_inside(module, a) for a in allowed):
                found.append(f"{path.relative_to(ROOT)}:{line} imports {module}")
    return found


@pytest.mark.parametrize("room", [room for room in MAY_IMPORT if sources(room)])
def test_a_room_imports_only_the_rooms_it_may(room):
    assert forbidden_imports(room) == []


def test_the_rotor_model_uses_numpy_scipy_and_pydantic_only():
    used = {
        (path.name, module.split(".")[0])
        for path in sources("rotor")
        for _, module in imports(ast.parse(path.read_text(encoding="utf-8")), module_name(path.parent / "__init__.py"))
    }
    assert used, "no import was seen: the check itself is broken"
    assert {(file, package) for file, package in used if package not in ROTOR_MAY_USE} == set()


@pytest.mark.parametrize(
    "source", ["import fmu_src.slave", "def f():\n    from fmu_src import slave", "from ..x import y"]
)
def test_the_check_sees_imports_in_any_form(source):
    """A guard that sees nothing guards nothing."""
    modules = [module for _, module in imports(ast.parse(source), "rigtwin.sim.formats")]
    assert modules in (["rigtwin.fmu_src.slave"], ["rigtwin.sim.x.y"])


def importable(package: str) -> list[str]:
    """A package with all its modules, or one module."""
    path = ROOT / Path(*package.split("."))
    files = [path.with_suffix(".py")] if path.with_suffix(".py").exists() else sorted(path.rglob("*.py"))
    names = [module_name(file) for file in files if file.name != "__main__.py"]
    return names if package == "rotor" else names[:1]


@pytest.mark.parametrize("package", [p for p in LIGHT_PACKAGES if importable(p)])
def test_importing_a_package_loads_nothing_heavy(package):
    """In a fresh interpreter: for rotor every module, elsewhere the package itself."""
    script = f"import sys, importlib; [importlib.import_module(m) for m in {importable(package)}]; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {module.split(".")[0] for module in run.stdout.split()}
    assert package.split(".")[0] in loaded
    assert loaded & LIGHT_PACKAGES[package] == set()


@pytest.mark.parametrize("room", ["rotor", "sim", "estimator", "gap", "fmu_src", "rigtwin", "gap/audit", "gap/blind"])
def test_every_module_stands_in_the_table_of_its_room(room):
    folder = ROOT / room
    table = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    modules = {path.stem for path in folder.glob("*.py") if not path.stem.startswith("__")}
    assert {name for name in modules if f"`{name}`" not in table} == set()
