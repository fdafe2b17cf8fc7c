"""Static condensation: the paper's way of dropping the rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigtwin.rotor.model.structure import DOF_PER_NODE
from rigtwin.rotor.model.system import LinearSystem


def condense_tilt(system: LinearSystem) -> LinearSystem:
    """Condense the rotations out of a non-spinning system (Guyan, *AIAA Journal* 3, 1965, 380).

    T = [1; -K_ss^-1 K_sm]: the removed rotations follow the kept deflections statically. The stiffness
    is exact and the mass approximate. The gyroscopic matrix acts on the rotations and is condensed
    with them, so use the full system for a spinning rotor.

    Returns
    -------
    LinearSystem on the free deflections; its shaft damping follows from the condensed matrices

    >>> system = build_system(assemble(load_rig("nit-rourkela")), Condition(rigid_support=True))
    >>> system.n, condense_tilt(system).n
    (24, 10)
    """
    tilt = (system.free < system.structure.n) & (system.free % DOF_PER_NODE >= 2)
    kept, dropped = np.flatnonzero(~tilt), np.flatnonzero(tilt)
    T = np.zeros((system.n, len(kept)))
    T[kept, np.arange(len(kept))] = 1.0
    T[dropped] = -np.linalg.solve(system.K[np.ix_(dropped, dropped)], system.K[np.ix_(dropped, kept)])
    names = ("M", "K", "G", "K_shaft", "C_support")
    matrices = {name: T.T @ getattr(system, name) @ T for name in names}
    return replace(system, **matrices, free=system.free[kept], plane=system.plane[kept], sensors=system.sensors @ T)
