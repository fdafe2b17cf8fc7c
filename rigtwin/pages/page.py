"""One self-contained HTML page: one embedded plotly.js, no address outside the file."""

from __future__ import annotations

import json
import lzma
from importlib.resources import files
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from rigtwin.pages.palette import ON_DARK, style_variables
from rigtwin.scratch import replacing
from rigtwin.wording import unbroken


def write_page(template: str, path: Path, **content: Any) -> Path:
    """Render a template; an existing page is replaced only when the new one is complete."""
    shared = {
        "plotly_js": Markup(plotly_js()),
        "colours": Markup(style_variables()),
        "on_dark": json_in_html({light.lower(): dark for light, dark in ON_DARK.items()}),
    }
    text = render(template, **shared, **content)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", errors="replace")  # names of files may be any bytes
    return path


def render(template: str, **content: Any) -> str:
    """A template with its content."""
    environment = Environment(
        loader=PackageLoader("rigtwin.pages", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": _figure_html, "unbroken": unbroken}
    return environment.get_template(template).render(**content)


def plotly_js() -> str:
    """plotly.js with what the pages draw and no more, a third of the whole library."""
    packed = files("rigtwin.pages").joinpath("vendor", "plotly-cartesian.min.js.xz").read_bytes()
    return lzma.decompress(packed).decode("utf-8")


def json_in_html(value: Any) -> Markup:
    """JSON that may stand in a script element: no text of a user can end the element."""
    return _in_script(json.dumps(value, ensure_ascii=False, separators=(",", ":")))


def _in_script(text: str) -> Markup:
    return Markup(text.replace("<", "\\u003c"))


def _figure_html(figure: go.Figure, name: str) -> Markup:
    """The place of a figure, told to a screen reader in words, and what the page's script draws there."""
    layout: Any = figure.layout
    return Markup(
        f'<div class="figure" id="{name}" role="img" aria-label="{escape(layout.meta)}" '
        f'style="height:{layout.height}px"></div>\n'
        f'<script type="application/json" id="{name}-figure">{_in_script(str(figure.to_json()))}</script>'
    )
