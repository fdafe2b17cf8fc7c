"""Code of the force laws: ``rotor/printed_laws.py`` and ``fmu_src/native/laws.[hc]``, written by ``build_laws.py``.

Each law of ``rotor/model/force_laws.py`` is an expression; sympy differentiates it and prints force and
derivatives together, with common subexpressions computed once, for Python floats, for numpy arrays
and for C.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import sympy
from sympy.printing.c import C99CodePrinter
from sympy.printing.numpy import NumPyPrinter
from sympy.printing.pycode import PythonCodePrinter

from rigtwin.rotor.model import force_laws
from rigtwin.rotor.model.force_laws import LAWS, ForceLaw

_HEADER = '''"""Printed by ``python build_laws.py`` from ``force_laws.py``; do not edit.

Every function returns the force [N] and its derivatives: ``SCALAR``, for floats, by the law's variables; ``ARRAY``,
for the laws without memory and numpy arrays of equal shape, by the displacement and by the corner's rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy
'''


def force(law: ForceLaw) -> sympy.Expr:
    """The law's force as a sympy expression of its real arguments."""
    symbols = {name: sympy.Symbol(name, real=True) for name in law.arguments}
    corner = symbols.get("corner", sympy.Integer(0))
    functions = {
        "pos": lambda u: (u + sympy.sqrt(u**2 + corner**2)) / 2,
        "limited": lambda u, a: sympy.Piecewise((a, u > a), (-a, u < -a), (u, True)),
    }
    names: dict[str, Any] = {**symbols, **functions}
    return sympy.parse_expr(law.force, local_dict=names)


def force_and_derivatives(law: ForceLaw, variables: Sequence[str] | None = None) -> list[sympy.Expr]:
    """[F, dF/dv for every variable v]; the law's own by default."""
    F = force(law)
    return [F, *(sympy.diff(F, sympy.Symbol(v, real=True)) for v in variables or law.variables)]


def print_python() -> str:
    """Source of ``printed_laws.py``."""
    parts = [_HEADER]
    for kind, printer in (("scalar", PythonCodePrinter), ("array", NumPyPrinter)):
        doprint = printer({"fully_qualified_modules": True}).doprint
        variables = None if kind == "scalar" else ("x", "corner")
        parts += [_python_function(law, f"_{law.name}_{kind}", doprint, variables) for law in _laws(kind)]
    for kind in ("scalar", "array"):
        entries = "".join(f'    "{law.name}": _{law.name}_{kind},\n' for law in _laws(kind))
        parts.append(f"{kind.upper()}: dict[str, Callable[..., tuple[Any, ...]]] = {{\n{entries}}}\n")
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _laws(kind: str) -> list[ForceLaw]:
    """A law with memory follows one path through time: it has no array form."""
    return [law for law in LAWS if kind == "scalar" or not law.memory]


def _python_function(law: ForceLaw, name: str, doprint: Callable[..., Any], variables: Sequence[str] | None) -> str:
    shared, results = _share(force_and_derivatives(law, variables))
    body = [f"    {symbol} = {doprint(value)}" for symbol, value in shared]
    returned = ", ".join(doprint(value) for value in results)
    arguments = ", ".join(law.arguments)
    return "\n".join([f"def {name}({arguments}):", *body, f"    return {returned}"])


def _share(expressions: list[sympy.Expr]) -> tuple[list[tuple[sympy.Symbol, sympy.Expr]], list[sympy.Expr]]:
    """Common subexpressions, and the expressions in terms of them."""
    shared, results = sympy.cse(expressions, optimizations="basic")
    return shared, list(results)  # type: ignore[arg-type]


def print_c(law: ForceLaw) -> str:
    """A C99 function: double law(arguments, double *derivatives)."""
    printer: Any = C99CodePrinter({"math_macros": {}})  # M_SQRT2 and the like are not C99
    shared, results = _share(force_and_derivatives(law))
    arguments = ", ".join(f"double {a}" for a in law.arguments)
    lines = [f"static double {law.name}({arguments}, double *derivatives)", "{"]
    lines += [f"    const double {symbol} = {printer.doprint(value)};" for symbol, value in shared]
    lines += [f"    derivatives[{k}] = {printer.doprint(value)};" for k, value in enumerate(results[1:])]
    return "\n".join([*lines, f"    return {printer.doprint(results[0])};", "}"])


_C_REMARK = "/* Printed by python build_laws.py from rotor/model/force_laws.py; do not edit. */"


def print_c_header() -> str:
    """Source of ``laws.h``: numbers of the laws, and what they are."""
    numbers = ", ".join(f"LAW_{law.name.upper()}" for law in LAWS)
    return f"""{_C_REMARK}
#ifndef RIGTWIN_LAWS_H
#define RIGTWIN_LAWS_H

#include "names.h"

enum {{ {numbers}, N_LAWS }};

typedef struct {{
    const char *name;
    int memory, radial;
}} Law;

extern const Law LAWS[N_LAWS];

/* Force [N] of a law and its derivatives by its variables: x, or x, x_before, force_before of one with memory. */
double law_force(int law, const double *variables, const double *coefficients, double *derivatives);

#endif
"""


def print_c_source() -> str:
    """Source of ``laws.c``."""
    rows = [f'    {{"{law.name}", {law.memory:d}, {law.radial:d}}},' for law in LAWS]
    return "\n".join(
        [
            _C_REMARK,
            '#include "laws.h"',
            "",
            "#include <math.h>",
            "",
            "const Law LAWS[N_LAWS] = {",
            *rows,
            "};",
            "",
            *(f"{print_c(law)}\n" for law in LAWS),
            "double law_force(int law, const double *variables, const double *coefficients, double *derivatives)",
            "{",
            "    switch (law) {",
            *(line for law in LAWS for line in _c_case(law)),
            "    }",
            "    return NAN;",
            "}",
            "",
        ]
    )


def _c_case(law: ForceLaw) -> list[str]:
    arguments = [f"variables[{k}]" for k in range(len(law.variables))]
    arguments += [f"coefficients[{k}]" for k in range(len(law.coefficients))]
    return [f"    case LAW_{law.name.upper()}:", f"        return {law.name}({', '.join(arguments)}, derivatives);"]


def printed() -> dict[Path, str]:
    """Every printed file with its text."""
    native = Path(__file__).with_name("native")
    return {
        Path(force_laws.__file__).with_name("printed_laws.py"): print_python(),
        native / "laws.h": print_c_header(),
        native / "laws.c": print_c_source(),
    }


def main() -> int:
    """Write every file beside its place and rename."""
    for target, text in printed().items():
        beside = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            beside.write_text(text, encoding="utf-8")
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)
        print(target)
    return 0
