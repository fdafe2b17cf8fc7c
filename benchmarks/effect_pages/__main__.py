"""The pages of docs/effects: ``python -m benchmarks.effect_pages`` writes them, and draws their figures.

Everything on a page comes from the effect's class, its force law, and docs/references.bib.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rigtwin.commands.effects import LOCATIONS, limits, parameters_of, places_of
from rigtwin.gap.phrases import lowered
from rigtwin.rotor.effects import EFFECTS, Effect, Parameter
from rigtwin.rotor.effects.scale import in_own_units
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.force_laws import ForceLaw
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.wording import number, unit

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "effects"
REFERENCES = FOLDER.parent / "references.bib"

_LINE_LENGTH = 120

FAMILIES = {
    "structure": "Shaft, disks and what hangs on them",
    "support": "Bearings and what they stand on",
    "nonlinear": "Local nonlinear forces",
    "chain": "The measurement chain",
    "spinning": "Spinning",
}

_INTRODUCTION = (
    "An effect is something that a real rig may have and the nominal rotor does not have. Each page gives the "
    "equation, the parameters with their prior ranges for the paper's rotor, the places where the effect can occur, "
    "its signs in a measurement, and a source. Effects can be combined, and their order does not matter. "
    "`rigtwin effects` prints the same facts in a terminal, and `rigtwin effects --json` prints them for a program.",
    "These pages are written by `make effect-pages` from `rotor/effects`; do not edit them.",
)


# -- pages ---------------------------------------------------------------------------------------


def pages() -> dict[str, str]:
    """Text of every page by file name."""
    references = read_references(REFERENCES.read_text(encoding="utf-8"))
    return {"README.md": overview()} | {f"{key}.md": page(effect, references) for key, effect in EFFECTS.items()}


def overview() -> str:
    """All effects by family."""
    parts = ["# Effects", *map(_wrapped, _INTRODUCTION)]
    for family, title in FAMILIES.items():
        rows = [
            (f"[{effect.id}]({effect.id}.md)", effect.meaning, effect.signature)
            for effect in EFFECTS.values()
            if effect.family == family
        ]
        parts += [f"## {title}", _table(("effect", "what it is", "what it looks like"), rows)]
    return "\n\n".join(parts) + "\n"


def page(effect: type[Effect], references: Mapping[str, str]) -> str:
    """The page of one effect."""
    from benchmarks.effect_pages.figures import FIGURES, SETTING

    figure = FIGURES[effect.id]
    parts = [
        f"# {effect.title}",
        f"`{effect.id}` · [{FAMILIES[effect.family].lower()}](README.md)",
        _sentence(effect.meaning),
        f"$$ {effect.equation} $$",
        *_law(effect),
        "## Parameters",
        _table(_HEADER, _parameter_rows(effect)),
        _wrapped(_whereabouts(effect)),
        "## What it looks like",
        _sentence(effect.signature),
        f"![{effect.title}](figures/{effect.id}.png)",
        _wrapped(f"{figure.caption} {figure.setting or SETTING}"),
        "## Source",
        _wrapped(references[effect.source]),
    ]
    return "\n\n".join(parts) + "\n"


_HEADER = ("name", "unit", "meaning", "start", "prior range", "uniform in", "no effect at", "allowed range")


def _parameter_rows(effect: type[Effect]) -> Iterator[tuple[str, ...]]:
    for name, start, role in parameters_of(effect):
        even = "its logarithm" if role.log else "itself"
        spread = f"{number(role.low)} to {number(role.high)} {in_own_units(role.unit)}".rstrip()
        yield f"`{name}`", unit(role.unit) or "–", role.meaning, number(start), spread, even, _off(role), limits(role)


def _off(role: Parameter) -> str:
    if role.null is None:
        return "–"
    return f"the test's `{role.null}`" if isinstance(role.null, str) else number(role.null)


def _whereabouts(effect: type[Effect]) -> str:
    """Where the effect may sit, in the rotor and in the FMU."""
    fields = [f" (`{name}`: {lowered(role.meaning)})" for name, _, role in places_of(effect)]
    sentences = [f"Where: {LOCATIONS[effect.location]}{''.join(fields)}."]
    if not effect.is_candidate:
        sentences.append("A diagnosis never names it as a cause; it is fitted where the cause is unknown.")
    if not effect.in_fmu:
        sentences.append("The FMU does not have it, because it belongs to the measurement and not to the rotor.")
    elif effect.changes_size:
        sentences.append(
            "It changes the number of degrees of freedom, so in the FMU it must be set before the simulation starts."
        )
    return " ".join(sentences)


def _table(header: tuple[str, ...], rows: Any) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + "."


def _wrapped(text: str) -> str:
    return textwrap.fill(text, _LINE_LENGTH, break_long_words=False, break_on_hyphens=False)


# -- force laws ----------------------------------------------------------------------------------

# Letters of the equations for the names of the coefficients.
_LETTERS = {
    "x": "x", "k": "k", "k3": "k_3", "gap": "g", "d0": "d_0", "ratio": r"\rho", "limit": "F_c",
    "x_before": "x_{-}", "force_before": "F_{-}", "corner": r"\varepsilon",
}  # fmt: skip


def _law(effect: type[Effect]) -> list[str]:
    """The effect's force law as sympy prints it; nothing for an effect without one."""
    forces = build_model(_rotor(), Condition(), [effect()]).forces if effect.family == "nonlinear" else ()
    if not forces:
        return []
    law = forces[0].law
    words = "As force law, in addition to the linear stiffness of the joint" if not law.memory else "As force law"
    if effect.location == "node":
        words = "As force law"
    parts = [f"{words}:", f"$$ F = {latex(law)} $$"]
    if "pos" in law.force:
        rounded = r"$(u)_+ = \tfrac12\left(u + \sqrt{u^2 + \varepsilon^2}\right)$"
        parts.append(f"Here {rounded} is the positive part of u, with its corner rounded over a length ε.")
    if law.memory:
        parts.append("Here x₋ and F₋ are the displacement and the force before, and the bracket is limited to ± F_c.")
    return parts


def latex(law: ForceLaw) -> str:
    """A force law in LaTeX."""
    import sympy  # for these pages only; the laws themselves are printed once and kept

    class Pos(sympy.Function):
        def _latex(self, printer: Any, exp: str = "") -> str:
            power = f"^{{{exp}}}" if exp else ""
            return rf"\left({printer.doprint(self.args[0])}\right)_{{+}}{power}"

    class Limited(sympy.Function):
        def _latex(self, printer: Any) -> str:
            inner, bound = map(printer.doprint, self.args)
            return rf"\left[{inner}\right]_{{-{bound}}}^{{+{bound}}}"

    symbols = {name: sympy.Symbol(name, real=True) for name in law.arguments}
    names: dict[str, Any] = {**symbols, "pos": Pos, "limited": Limited}
    expression = sympy.parse_expr(law.force, local_dict=names, evaluate=False)
    return sympy.latex(expression, symbol_names={symbols[name]: _LETTERS[name] for name in symbols}, order="none")


def _rotor() -> Any:
    from benchmarks.effect_pages.plots import jointed_rotor

    return jointed_rotor(1)


# -- references ----------------------------------------------------------------------------------


def read_references(text: str) -> dict[str, str]:
    """Citation of every entry of a BibTeX file, by key."""
    entries = re.findall(r"^@(\w+)\{(\w+),\n(.*?)^\}", text, re.MULTILINE | re.DOTALL)
    return {key: _citation(_fields(body)) for _, key, body in entries}


def _fields(body: str) -> dict[str, str]:
    found = re.findall(r"(\w+)\s*=\s*\{((?:[^{}]|\{[^{}]*\})*)\}", body)
    return {name: _plain(value) for name, value in found}


def _plain(tex: str) -> str:
    """Text of BibTeX: accents, dashes and protecting braces resolved."""
    for accent, letter in ((r"{\"a}", "ä"), (r"{\'o}", "ó")):
        tex = tex.replace(accent, letter)
    return re.sub(r"[{}]", "", tex).replace("--", "–")


def _citation(entry: Mapping[str, str]) -> str:
    """'A. Author and B. Author, *Title*, Journal 1(2), 3–4, 1990, doi'."""
    authors = [" ".join(reversed(name.split(", "))) for name in entry.get("author", "").split(" and ")]
    people = ", ".join(authors[:-1]) + (" and " if len(authors) > 1 else "") + authors[-1]
    parts = [people, f"*{entry['title']}*"]
    if "journal" in entry:
        volume = f" {entry['volume']}" if "volume" in entry else ""
        issue = f"({entry['number']})" if "number" in entry else ""
        parts.append(f"{entry['journal']}{volume}{issue}, {entry['pages']}")
    parts += [f"{entry['edition']} edition"] if "edition" in entry else []
    parts += [entry[name] for name in ("booktitle", "publisher", "year") if name in entry]
    doi = f", [doi:{entry['doi']}](https://doi.org/{entry['doi']})" if "doi" in entry else ""
    return ", ".join(parts) + doi + "."


# -- writing -------------------------------------------------------------------------------------


def write_pages(folder: Path) -> None:
    """Write all pages."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


def draw_figures(folder: Path, ids: list[str]) -> None:
    """Draw the figures of some effects."""
    from benchmarks.effect_pages.figures import FIGURES
    from benchmarks.effect_pages.plots import save

    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for effect_id in ids:
        save(FIGURES[effect_id].panels, folder / "figures" / f"{effect_id}.png")
        print(folder / "figures" / f"{effect_id}.png")


def main(arguments: list[str]) -> int:
    """Write every page; draw the figures of the effects that are named, by default of all."""
    unknown = [name for name in arguments if name not in EFFECTS]
    if unknown:
        print(f"no such effect: {', '.join(unknown)}; rigtwin effects lists them all", file=sys.stderr)
        return 2
    write_pages(FOLDER)
    draw_figures(FOLDER, arguments or list(EFFECTS))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
