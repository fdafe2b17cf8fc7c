"""Sphinx: ``make docs`` builds the pages of this folder into build/docs."""

from __future__ import annotations

import re
from importlib.metadata import version as version_of

from pygments.lexers.special import TextLexer

project = "rigtwin"
author = "The rigtwin developers"
release = version = version_of("rigtwin")
copyright = author

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

html_theme = "furo"
html_title = "rigtwin"
html_static_path = ["_static"]
html_css_files = ["rigtwin.css"]
html_show_sphinx = False

myst_enable_extensions = ["dollarmath", "attrs_inline"]
myst_heading_anchors = 5
myst_links_external_new_tab = False

# The tutorial runs when the pages are built; an error in it is an error of the build.
nb_execution_mode = "force"
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False

_OUT_OF_THE_PAGES = re.compile(r"\[(?P<text>[^\]]+)\]\((?:\.\./)+(?P<path>(?!docs/)[^)#\s]+)(?:#[^)]*)?\)")


def _as_pages(_app, docname: str, source: list[str]) -> None:
    """The pages as they are built: files of the repository are named, and effects stand below their list."""
    if docname == "effects/README":
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n*\n```\n"
    source[0] = _OUT_OF_THE_PAGES.sub(lambda found: _named(found["text"], found["path"]), source[0])


def _named(text: str, path: str) -> str:
    return text if path in text else f"{text} (`{path}` in the repository)"


_ENTRY = re.compile(r"^(?P<names>\w+(?:, \w+)*) : (?P<words>.+)$")
_WITH_ENTRIES = {"Parameters", "Raises"}


def _for_napoleon(_app, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """The short form of the docstrings as numpydoc has it: "name : words" in two lines, examples with a heading."""
    section, told = "", []
    for place, line in enumerate(lines):
        if place + 1 < len(lines) and set(lines[place + 1]) == {"-"}:
            section = line
        entry = _ENTRY.match(line) if section in _WITH_ENTRIES else None
        if line.startswith(">>>") and section != "Examples":
            section = "Examples"
            told += ["", section, "-" * len(section), line]
        elif entry:
            told += [entry["names"], f"    {entry['words']}"]
        else:
            told.append(line)
    lines[:] = told


def setup(app) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _for_napoleon, priority=400)  # napoleon has 500
    app.add_lexer("csv", TextLexer)
    app.connect("source-read", _as_pages)
