"""One self-contained HTML page: one embedded plotly.js, no address outside the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from rigtwin.scratch import replacing
from rigtwin.wording import unbroken

_CONFIG = '{"responsive": true, "displaylogo": false, "displayModeBar": false}'


def write_page(template: str, path: Path, **content: Any) -> Path:
    """Render a template; an existing page is replaced only when the new one is complete."""
    environment = Environment(
        loader=PackageLoader("rigtwin.pages", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": _figure_html, "unbroken": unbroken}
    text = environment.get_template(template).render(plotly_js=Markup(get_plotlyjs()), **content)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", errors="replace")  # names of files may be any bytes
    return path


def _figure_html(figure: go.Figure, name: str) -> Markup:
    """A figure's place and the script that draws it; "</" in a label must not end the script."""
    drawing = str(figure.to_json()).replace("</", "<\\/")
    height = figure.layout.height
    return Markup(
        f'<div class="figure" id="{name}" style="height:{height}px"></div>\n'
        f"<script>{{const f = {drawing}; "
        f'Plotly.newPlot("{name}", f.data, f.layout, {_CONFIG});}}</script>'
    )
