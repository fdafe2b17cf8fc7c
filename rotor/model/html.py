"""Small tables and drawings for notebooks: HTML and SVG in the colours of the page around them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray

# A curve with more points than the drawing has pixels shows no more.
_MOST_POINTS = 1200
_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP, _RIGHT = 560, 230, 62, 34, 10, 10


def table(header: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """A table in HTML; the first column is left-aligned, the others right-aligned.

    >>> table(["mode", "Hz"], [["1", 100.6]])
    '<table><thead><tr><th>mode</th><th>Hz</th></tr></thead><tbody><tr><th>1</th><td>100.6</td></tr></tbody></table>'
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{_cells(row)}</tr>" for row in rows)
    above = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{above}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _cells(row: Sequence[object]) -> str:
    first, *others = (escape(str(cell)) for cell in row)
    return f"<th>{first}</th>" + "".join(f"<td>{cell}</td>" for cell in others)


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """A table of names and values in HTML."""
    rows = "".join(f"<tr>{_cells((name, value))}</tr>" for name, value in pairs)
    return f"<table><tbody>{rows}</tbody></table>"


def paragraph(text: str) -> str:
    """A paragraph in HTML."""
    return f"<p>{escape(text)}</p>"


def drawing(content: str, width: float, height: float, words: str) -> str:
    """An SVG that is as wide as its place, told to a screen reader in words."""
    return (
        f'<svg role="img" aria-label="{escape(words)}" viewBox="0 0 {width:g} {height:g}" fill="none" '
        f'stroke="currentColor" font-family="sans-serif" font-size="12" '
        f'style="max-width:{width:g}px;width:100%;height:auto">{content}</svg>'
    )


@dataclass(frozen=True)
class Line:
    """A curve to be drawn."""

    x: FloatArray
    y: FloatArray
    label: str = ""
    colour: str = "currentColor"
    dash: str = ""  # of the SVG attribute stroke-dasharray


def curves(lines: Sequence[Line], x_title: str, y_title: str) -> str:
    """Curves over a linear x axis and a logarithmic y axis, as SVG; y that is not positive is left out."""
    shown = [(line, (line.y > 0) & np.isfinite(line.y)) for line in lines]
    x = np.concatenate([line.x[use] for line, use in shown])
    y = np.log10(np.concatenate([line.y[use] for line, use in shown]))
    if not x.size:
        return ""
    across, up = _Axis(x.min(), x.max(), _LEFT, _WIDTH - _RIGHT), _Axis(y.min(), y.max(), _HEIGHT - _BOTTOM, _TOP)
    parts = [_frame(), _x_ticks(across, x_title), _y_ticks(up, y_title)]
    for place, (line, use) in enumerate(shown):
        every = max(1, int(np.count_nonzero(use)) // _MOST_POINTS)
        points = zip(across(line.x[use])[::every], up(np.log10(line.y[use]))[::every], strict=True)
        path = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
        dash = f' stroke-dasharray="{line.dash}"' if line.dash else ""
        parts.append(f'<polyline points="{path}" stroke="{line.colour}" stroke-width="1.5"{dash}/>')
        parts.append(_text(_WIDTH - _RIGHT - 4, _TOP + 14 * (place + 1), line.label, "end", line.colour))
    return drawing("".join(parts), _WIDTH, _HEIGHT, f"{y_title} over {x_title}")


@dataclass(frozen=True)
class _Axis:
    """From values to pixels."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, values: FloatArray) -> FloatArray:
        span = max(self.high - self.low, 1e-9)
        return self.start + (np.asarray(values) - self.low) / span * (self.end - self.start)


def _frame() -> str:
    return f'<path d="M{_LEFT} {_TOP}V{_HEIGHT - _BOTTOM}H{_WIDTH - _RIGHT}" stroke-opacity="0.6"/>'


def _x_ticks(axis: _Axis, title: str) -> str:
    values = _round_numbers(axis.low, axis.high)
    bottom = _HEIGHT - _BOTTOM
    marks = "".join(
        f'<path d="M{x:.1f} {bottom}v4"/>' + _text(x, bottom + 16, f"{value:g}", "middle")
        for value, x in zip(values, axis(values), strict=True)
    )
    return marks + _text((_LEFT + _WIDTH) / 2, _HEIGHT - 4, title, "middle")


def _y_ticks(axis: _Axis, title: str) -> str:
    """Powers of ten, few enough to be read."""
    first, last = int(np.ceil(axis.low)), int(np.floor(axis.high))
    powers = np.arange(first, last + 1, max(1, (last - first) // 5 + 1), dtype=float)
    marks = "".join(
        f'<path d="M{_LEFT} {y:.1f}h-4"/>' + _text(_LEFT - 7, y + 4, f"{10.0**power:.0e}".replace("e+0", "e"), "end")
        for power, y in zip(powers, axis(powers), strict=True)
    )
    middle = (_TOP + _HEIGHT - _BOTTOM) / 2
    return marks + _text(12, middle, title, "middle", turn=f' transform="rotate(-90 12 {middle:g})"')


def _round_numbers(low: float, high: float, about: int = 6) -> FloatArray:
    """Multiples of 1, 2 or 5 times a power of ten between two numbers."""
    rough = max(high - low, 1e-9) / about
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * min((m for m in (1, 2, 5, 10) if m * power >= rough), default=10)
    return np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step


def _text(x: float, y: float, words: str, anchor: str, colour: str = "currentColor", turn: str = "") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" stroke="none" fill="{colour}"{turn}>'
        f"{escape(words)}</text>"
    )
