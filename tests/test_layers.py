"""Who may import whom, checked on the source; and one import name for all."""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Folders at the top of the repository, imported as rigtwin.<folder>.
ROOMS = ("rotor", "sim", "estimator", "fmu_src", "gap", "blind")

# Temporary folders, files that are replaced, TOML and JSON, with the standard library alone: open to all but ``blind``.
GROUND = ("rigtwin.scratch", "rigtwin.parsing", "rigtwin.shared_work")

# Each room may import itself and what stands here. A dotted entry opens one module, not the room.
MAY_IMPORT = {
    "rigtwin.rotor": (),
    "rigtwin.sim": ("rigtwin.rotor",),
    "rigtwin.estimator": ("rigtwin.rotor", "rigtwin.sim"),
    "rigtwin.gap": ("rigtwin.rotor", "rigtwin.sim"),
    "rigtwin.fmu_src": (
        "rigtwin.rotor", "rigtwin.estimator.runtime", "rigtwin.estimator.tracking", "rigtwin.estimator.intervals",
    ),
    "rigtwin.blind.generate": ("rigtwin.blind",),
    "rigtwin.blind.judge": ("rigtwin.blind",),
    "rigtwin.api": (
        "rigtwin.rotor", "rigtwin.sim", "rigtwin.estimator", "rigtwin.gap", "rigtwin.fmu_src", "rigtwin.pages",
        "rigtwin.errors", "rigtwin.wording", "rigtwin.scale_out", "rigtwin.scratch", "rigtwin.shared_work",
        "rigtwin.workers",
    ),
    "rigtwin.app": (
        "rigtwin.api", "rigtwin.pages", "rigtwin.errors", "rigtwin.scale_out", "rigtwin.scratch", "rigtwin.workers",
    ),
    "rigtwin.pages": (
        "rigtwin.rotor", "rigtwin.sim", "rigtwin.gap", "rigtwin.fmu_src", "rigtwin.estimator", "rigtwin.wording",
    ),
}  # fmt: skip

# Inside a room, from the ground up: what stands later may import what stands before, and not the other way round.
ORDERS = {
    "rigtwin.rotor": ("model", "geometry", "effects", "frequency", "time"),
    "rigtwin.gap": (
        "document", "phrases", "curves", "clock", "audit", "model", "inference", "search", "verdict", "prepare",
        "explain", "answer", "peaks", "predict", "diagnose",
    ),
    "rigtwin.blind": ("generate", "judge"),
}  # fmt: skip
ROTOR_MAY_USE = {"numpy", "scipy", "pydantic", "rigtwin"} | set(sys.stdlib_module_names)

# What merely importing a package must not load: FMU tools, neural networks, plots.
HEAVY = {"fmpy", "pythonfmu", "torch", "onnx", "onnxruntime", "plotly", "matplotlib", "sympy"}
LIGHT_PACKAGES = {
    "rigtwin.rotor": HEAVY,
    "rigtwin.estimator.runtime": HEAVY - {"onnxruntime"},
    "rigtwin.sim": HEAVY - {"fmpy"},
    "rigtwin.commands.modes": HEAVY | {"h5py", "scipy.io"},
    "rigtwin.cli": HEAVY | {"scipy", "numpy", "pydantic", "rich"},
}


def folder_of(package: str) -> Path:
    """Where a package, or a module without its suffix, lies."""
    parts = package.split(".")[1:]
    return ROOT.joinpath(*parts) if parts and parts[0] in ROOMS else ROOT.joinpath("rigtwin", *parts)


def sources(package: str) -> list[Path]:
    """Python files of a package, or of one module."""
    single = folder_of(package).with_suffix(".py")
    return [single] if single.exists() else sorted(folder_of(package).rglob("*.py"))


def module_name(path: Path) -> str:
    """Its name as it is imported."""
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    return f"rigtwin.{name}" if name.split(".")[0] in ROOMS else name


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


def imports_of(path: Path) -> Iterator[tuple[int, str]]:
    """(line, dotted module) of every import of a file."""
    package = module_name(path if path.name == "__init__.py" else path.parent / "__init__.py")
    return imports(ast.parse(path.read_text(encoding="utf-8")), package)


@pytest.mark.parametrize("room", list(MAY_IMPORT))
def test_a_room_imports_only_the_rooms_it_may(room):
    allowed = (room, *MAY_IMPORT[room], *([] if room.startswith("rigtwin.blind") else GROUND))
    arrows = [(path, line, module) for path in sources(room) for line, module in imports_of(path)]
    assert arrows
    found = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path, line, module in arrows
        if is_inside(module, "rigtwin") and not any(is_inside(module, a) for a in allowed)
    ]
    assert found == []


@pytest.mark.parametrize("room", list(ORDERS))
def test_inside_a_room_imports_go_one_way(room):
    order = [f"{room}.{name}" for name in ORDERS[room]]

    def floor(module: str) -> int:
        return next((k for k, part in enumerate(order) if is_inside(module, part)), -1)

    arrows = [
        (f"{path.relative_to(ROOT)}:{line} imports {module}", floor(module_name(path)), floor(module))
        for path in sources(room)
        if path != folder_of(room) / "__init__.py"
        for line, module in imports_of(path)
    ]
    assert min(above for _, above, _ in arrows) >= 0, "a part of the room has no place in its order"
    assert [words for words, here, there in arrows if there > here] == []


def test_the_rotor_model_uses_numpy_scipy_and_pydantic_only():
    used = {(path.name, module.split(".")[0]) for path in sources("rigtwin.rotor") for _, module in imports_of(path)}
    assert used, "no import was seen: the check itself is broken"
    assert {(file, package) for file, package in used if package not in ROTOR_MAY_USE} == set()


@pytest.mark.parametrize("folder", ["benchmarks", "examples"])
def test_what_no_test_runs_still_imports_what_there_is(folder):
    """Benchmarks take long, so that a name that has gone would be seen late."""
    lines = {
        f"from {node.module} import {name.name}"
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rigtwin")
        for name in node.names
    }
    assert len(lines) > 10
    done = subprocess.run([sys.executable, "-c", "\n".join(sorted(lines))], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_nothing_is_imported_by_the_name_of_its_folder():
    """A checkout's folders would be found under both names, and every module be there twice."""
    for folder in (*ROOMS, "rigtwin", "tests", "benchmarks", "examples"):
        for path in (ROOT / folder).rglob("*.py"):
            names = {module.split(".")[0] for _, module in imports_of(path)}
            assert not names & set(ROOMS), path


@pytest.mark.parametrize(
    "source", ["import rigtwin.fmu_src.slave", "def f():\n    from rigtwin.fmu_src import slave", "from ..x import y"]
)
def test_the_check_sees_imports_in_any_form(source):
    """A guard that sees nothing guards nothing."""
    modules = [module for _, module in imports(ast.parse(source), "rigtwin.sim.formats")]
    assert modules in (["rigtwin.fmu_src.slave"], ["rigtwin.sim.x.y"])


def importable(package: str) -> list[str]:
    """A package with all its modules, or one module."""
    names = [module_name(file) for file in sources(package) if file.name != "__main__.py"]
    return names if package == "rigtwin.rotor" else names[:1]


@pytest.mark.parametrize("package", list(LIGHT_PACKAGES))
def test_importing_a_package_loads_nothing_heavy(package):
    """In a fresh interpreter: for rotor every module, elsewhere the package itself."""
    script = f"import sys, importlib; [importlib.import_module(m) for m in {importable(package)}]; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {*run.stdout.split(), *(module.split(".")[0] for module in run.stdout.split())}
    assert "rigtwin" in loaded
    assert loaded & LIGHT_PACKAGES[package] == set()


PACKAGES = sorted({path.parent for room in (*ROOMS, "rigtwin") for path in (ROOT / room).rglob("__init__.py")})


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_every_module_stands_in_the_table_of_its_room(folder):
    table = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    names = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert {name for name in names if not name.startswith("__") and f"`{name}`" not in table} == set()


def test_every_package_is_installed():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    found = {module_name(folder / "__init__.py") for folder in PACKAGES} | {"rigtwin.paper_campaign"}
    assert sorted(listed) == sorted(found)


# -- effects are known by name in two places ---------------------------------------------------------------

# Words that are ids of effects, too.
OTHER_MEANINGS = {"disk_mass": "the masses of a Structure", "sensor_gain": "a key of the calibration in diagnosis.json"}
KNOWS_EFFECTS = (ROOT / "rotor" / "effects", ROOT / "gap" / "search" / "strategies", ROOT / "blind")


def test_effects_are_known_by_name_in_two_places_only():
    """Everything else reads what it has to know of an effect from the effect itself."""
    from dataclasses import fields

    from rigtwin.gap.search.strategies.registry import LAWS, LINEAR
    from rigtwin.rotor.effects import EFFECTS
    from rigtwin.rotor.model.condition import Condition

    assert set(LINEAR) | set(LAWS) <= set(EFFECTS)
    candidates = {name: effect for name, effect in EFFECTS.items() if effect.is_candidate}
    names = set(candidates) - {field.name for field in fields(Condition)} - set(OTHER_MEANINGS)
    in_text = {name for name in names if "_" in name} | {effect.__name__ for effect in candidates.values()}
    whole = names - in_text  # plain words in a sentence
    known = re.compile(rf"\b({'|'.join(sorted(in_text))})\b|^({'|'.join(sorted(whole))})(\..*)?$")
    found = []
    for room in (*ROOMS, "rigtwin"):
        for path in sorted((ROOT / room).rglob("*.py")):
            if not any(path.is_relative_to(home) for home in KNOWS_EFFECTS):
                found += [f"{path.relative_to(ROOT)}: {hit}" for hit in _in_code(path, known)]
    assert found == []


def _in_code(path: Path, known: re.Pattern[str]) -> list[str]:
    """Names and string constants that name an effect; docstrings may."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    told = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
    words = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            words.append(node.value)
        elif isinstance(node, ast.Name) and node.id[0].isupper():
            words.append(node.id)
        elif isinstance(node, ast.alias):
            words.append(node.name)
    return [word for word in words if known.search(word)]


def test_every_effect_has_a_search_strategy():
    from rigtwin.gap.inference.hypotheses import Hypothesis, Term
    from rigtwin.gap.search.strategies.law import LawStrategy
    from rigtwin.gap.search.strategies.registry import law_strategy_of, strategy_of
    from rigtwin.gap.search.strategies.strategy import Strategy
    from rigtwin.rotor.effects import EFFECTS

    for effect in EFFECTS.values():
        hypothesis = Hypothesis((Term(effect, (), ()),))
        if effect.family == "nonlinear":
            assert isinstance(law_strategy_of(hypothesis), LawStrategy)
        else:
            assert isinstance(strategy_of(hypothesis), Strategy)


# -- the diagnosis stays a house of few rooms -------------------------------------------------------------


def gap_rooms() -> tuple[set[str], set[tuple[str, str]]]:
    """Rooms of the diagnosis, and the arrows between them: who imports whom."""
    rooms, arrows = set(), set()
    for path in sources("rigtwin.gap"):
        if path == folder_of("rigtwin.gap") / "__init__.py":
            continue
        here = module_name(path).split(".")[2]
        rooms.add(here)
        there = {module.split(".")[2] for _, module in imports_of(path) if is_inside(module, "rigtwin.gap")}
        arrows |= {(here, room) for room in there - {here}}
    return rooms, arrows


def test_the_diagnosis_has_few_rooms_floors_and_arrows_and_no_circle():
    rooms, arrows = gap_rooms()

    def floor(room: str, above: tuple[str, ...] = ()) -> int:
        assert room not in above, f"a circle: {' -> '.join((*above, room))}"
        return 1 + max((floor(there, (*above, room)) for here, there in arrows if here == room), default=0)

    assert len(rooms) <= 16
    assert max(map(floor, rooms)) <= 8
    assert len(arrows) <= 60


def test_the_diagnosis_has_short_functions_and_few_constants_each_on_its_line():
    constants = 0
    for path in sources("rigtwin.gap"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target] if hasattr(node, "target") else []
            constants += len(targets)
            assert not any(isinstance(target, ast.Tuple) for target in targets), f"{path.name}:{node.lineno}"
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.end_lineno:
                assert node.end_lineno - node.lineno < 40, f"{path.name}: {node.name}"
    assert constants <= 130


MOST_LINES_OF_THE_DIAGNOSIS = 9_000


def lines_of_code(text: str) -> int:
    """Lines that hold code: neither blank, nor comments, nor docstrings."""
    tree, lines = ast.parse(text), set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node) is not None:
            told = node.body[0]
            lines -= set(range(told.lineno, (told.end_lineno or told.lineno) + 1))
    return len(lines)


_NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER
}  # fmt: skip


def test_lines_of_code_are_counted_without_words_about_it():
    words = '"""Of a module,\n\nin three lines."""\n\n# a comment\n'
    code = 'def f(x):\n    """Told."""\n    return (x +\n        1)  # why\n'
    assert lines_of_code(words + code) == 3
    assert lines_of_code('s = """two\nlines"""\n') == 2


def test_the_diagnosis_has_few_lines_of_code():
    count = sum(lines_of_code(path.read_text(encoding="utf-8")) for path in sources("rigtwin.gap"))
    print(f"lines of code of the diagnosis: {count}")  # shown by pytest -s
    assert 0 < count <= MOST_LINES_OF_THE_DIAGNOSIS


# -- the wheel ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from a copy of what is tracked: a build folder of the checkout takes no part."""
    copy, out = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("wheel")
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, tracked.stdout.split("\0")):
        if not name.startswith(("tests/", "docs/", "benchmarks/")) and (ROOT / name).exists():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            (copy / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out), str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return next(out.glob("*.whl"))


def test_the_wheel_brings_one_name_and_no_benchmark_data(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0].removesuffix(".dist-info").split("-")[0] for name in names} == {"rigtwin"}
    assert not [name for name in names if "stored_campaigns" in name or name.endswith(".npz")]
    assert wheel.stat().st_size < 1_600_000  # a third of it is plotly.js
    for data in (
        "rotor/rigs/nit-rourkela.toml",
        "pages/templates/page.html",
        "pages/templates/draw.js",
        "pages/vendor/plotly-cartesian.min.js.xz",
        "fmu_src/native/rotor.c",
    ):
        assert f"rigtwin/{data}" in names


def test_an_empty_environment_gets_one_name(wheel, tmp_path):
    """What its site-packages holds beside pip; and the installed command describes the effects."""
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / "bin" / "python"
    site = next((tmp_path / "env" / "lib").glob("python*/site-packages"))
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps", str(wheel)]
    subprocess.run(command, check=True, capture_output=True)
    assert {path.name.split("-")[0] for path in site.iterdir()} == {"rigtwin"}
    script = "import rigtwin, rigtwin.wording; print(rigtwin.__file__)"
    found = subprocess.run([python, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert str(site) in found.stdout
