"""Colours of all figures, whichever library draws them."""

from __future__ import annotations

# Okabe and Ito's colours, told apart by colour-blind readers too.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#8a8f98"
INK, GRID = "#1f2933", "#e4e7eb"
