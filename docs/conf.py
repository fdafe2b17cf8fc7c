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
autodoc_typehints = "none"  # the signature has them
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


def setup(app) -> None:
    """Called by Sphinx."""
    app.add_lexer("csv", TextLexer)
    app.connect("source-read", _as_pages)
