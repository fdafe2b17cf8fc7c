"""Colours of all pages and figures, whichever library draws them."""

from __future__ import annotations

# Okabe and Ito's colours, told apart by colour-blind readers too.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#8a8f98"
INK, GRID, EDGE, EMPTY, PAPER = "#1f2933", "#e4e7eb", "#c4cad1", "#eceff2", "#ffffff"

# Colours of the gap's map, evenly over the logarithm from 0.1 % to 100 %, and of the numbers in it: the first below the
# fifth colour, the second from there on. That colour is as far from black as from white, on either page.
MAP = (PAPER, "#fdf8ec", "#fbe6bd", "#f3b772", "#bd5825", "#8f2410")
ON_MAP = ("#000001", "#fffffe")

# What each colour of a figure is on a dark page.
ON_DARK = {
    BLUE: "#56b4e9",
    VERMILION: "#f08a4b",
    GREEN: "#3fc79a",
    PURPLE: "#dd9cc2",
    ORANGE: "#f0b429",
    GREY: "#9aa1ab",
    INK: "#e6e9ed",
    GRID: "#2b323b",
    EDGE: "#56606b",
    EMPTY: "#262d36",
    PAPER: "#14181d",
    MAP[1]: "#27241f",
    MAP[2]: "#4a3620",
    MAP[3]: "#854a24",
    MAP[4]: "#b2602f",
    MAP[5]: "#ffc29e",
    ON_MAP[0]: "#fffffe",
    ON_MAP[1]: "#000001",
}

# Colours of a page's text, lines and marks, by their names in the style sheet: on a light page, on a dark one.
PAGE = {
    "paper": (PAPER, ON_DARK[PAPER]),
    "ink": (INK, ON_DARK[INK]),
    "soft": ("#5f6b7a", "#a3adb8"),
    "line": ("#dde1e6", "#343c46"),
    "panel": ("#f4f6f8", "#1d232a"),
    "blue": (BLUE, "#63b3ec"),
    "good": ("#00724f", "#4fc59b"),
    "bad": ("#b23c00", "#ff9a6b"),
    "warn": ("#8a5a00", "#e0b040"),
    "plain": ("#4a5563", "#aab4c0"),
    **{f"map-{place}": (colour, ON_DARK[colour]) for place, colour in enumerate(MAP)},
}


def style_variables() -> str:
    """The page's colours as variables of its style sheet; printed on paper, a page is light.

    >>> style_variables()[:43]
    ':root { color-scheme: light; --paper: #ffff'
    """
    light, dark = (" ".join(f"--{name}: {shades[place]};" for name, shades in PAGE.items()) for place in range(2))
    return (
        f":root {{ color-scheme: light; {light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ color-scheme: dark; {dark} }} }}"
    )
