"""The sections of docs/reproduction.md in their order."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.reproduction.amplitudes import table_2_amplitudes
from benchmarks.reproduction.convergence import mesh_convergence
from benchmarks.reproduction.damping import damping_models
from benchmarks.reproduction.figures import figure_2, figure_3
from benchmarks.reproduction.networks import section as paper_networks
from benchmarks.reproduction.ross import ross
from benchmarks.reproduction.tables import table_1, table_2_shifts

Section = Callable[[], str]  # returns markdown that begins with a heading of level two

SECTIONS: list[Section] = [
    table_1,
    table_2_shifts,
    table_2_amplitudes,
    figure_2,
    figure_3,
    ross,
    mesh_convergence,
    damping_models,
    paper_networks,
]
