"""Where the gap lies: bands, supports, levels, nodes, and the joint stiffness that would explain it.

A joint dynamic stiffness dZ between the ground and node j turns the model's H into the measured one exactly
where, with e = H_model - H of every sensor s,

    e_s = H_model,sj g,   dZ = g / (H_model,jd - g H_model,jj)

(receptances). With several sensors g is fitted line by line, and what it explains ranks the nodes; with one sensor
every node explains everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rigtwin.gap.document import Band, JointStiffness, NodeShare, Regime, Where
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.observed import Observed
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.phrases import ten_to
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Run

# Laws a joint stiffness is compared with: name, unit of its size, what it looks like, and shape over omega.
LAWS = (
    ("a stiffness", "N/m", "constant and real", lambda w: np.ones(len(w), dtype=complex)),
    ("a mass", "kg", "real, falling with the square of the frequency", lambda w: -(w**2) + 0j),
    ("a viscous damper", "N s/m", "imaginary, rising with frequency", lambda w: 1j * w),
    ("a hysteretic damper", "N/m", "imaginary and constant", lambda w: 1j * np.ones(len(w))),
)


def locate(
    problem: Problem, nominal: Fit, predicted: Sequence[ComplexArray], regime: Regime, at: int | None = None
) -> Where:
    """Shares of the gap over bands, supports, levels and nodes.

    Parameters
    ----------
    problem, nominal : the runs, and the recalibrated nominal model
    predicted : its response for every run
    regime : what kind of gap it is
    at : node of the joint stiffness; None: the one that explains most of a run
    """
    misfits = [_misfit(o, H) for o, H in zip(problem.observed, predicted, strict=True)]
    supports: dict[str, float] = {"rigid": 0.0, "bearing": 0.0}
    levels: dict[str, float] = {}
    for observed, misfit in zip(problem.observed, misfits, strict=True):
        run = observed.run
        supports[run.support] = supports.get(run.support, 0.0) + float(misfit.sum())
        if run.force_amplitude_N is not None:
            level = f"{run.force_amplitude_N:g}"
            levels[level] = levels.get(level, 0.0) + float(misfit.sum())
    nodes, joint, remark = _nodes(problem, nominal, predicted, at)
    return Where(
        bands=_bands(problem, nominal, misfits),
        supports={name: _share(value, supports) for name, value in supports.items()},
        nodes=nodes,
        regime=regime,
        levels={name: _share(value, levels) for name, value in levels.items()},
        joint=joint,
        remark=remark,
    )


def _share(value: float, all_of_them: dict[str, float]) -> float:
    total = sum(all_of_them.values())
    return value / total if total > 0 else 1.0 / len(all_of_them)


def _misfit(observed: Observed, model: ComplexArray) -> FloatArray:
    """(n_freq,) squared error over the run's squared response, channel by channel, above what noise explains."""
    y = np.nan_to_num(observed.run.H)
    difference = np.abs(y) - np.abs(model) if observed.run.magnitude_only else y - model
    valid = observed.valid
    size = np.sum(np.where(valid, np.abs(y) ** 2, 0.0), axis=0)
    noise = np.where(valid, observed.error**2, 0.0)
    gap = np.where(valid, np.maximum(np.abs(difference) ** 2 - noise, 0.0), 0.0)
    moving = size > 1e-8 * size.max(initial=1e-300)
    return np.sum(gap[:, moving] / size[moving], axis=1)


def _bands(problem: Problem, nominal: Fit, misfits: Sequence[FloatArray]) -> tuple[Band, ...]:
    """Bands with one resonance each, of all runs together, cut half-way between resonances."""
    f_lo = min(run.frequency_hz[0] for run in problem.runs)
    f_hi = max(run.frequency_hz[-1] for run in problem.runs)
    counted = [m.frequencies_hz for m in problem.modals(nominal.k_b, nominal.effects)]
    inside = [(m, f[m]) for f in counted for m in np.flatnonzero((f > f_lo) & (f < f_hi))]
    if not inside:
        return (Band(float(f_lo), float(f_hi), None, 1.0),)
    by_mode = {m: float(np.median([f for k, f in inside if k == m])) for m, _ in inside}
    modes = sorted(by_mode, key=lambda m: by_mode[m])
    edges = [f_lo, *(float(np.sqrt(by_mode[a] * by_mode[b])) for a, b in pairwise(modes)), f_hi]
    sums = np.zeros(len(modes))
    for run, misfit in zip(problem.runs, misfits, strict=True):
        place = np.clip(np.searchsorted(edges[1:-1], run.frequency_hz), 0, len(modes) - 1)
        np.add.at(sums, place, misfit)
    total = sums.sum()
    shares = sums / total if total > 0 else np.full(len(modes), 1 / len(modes))
    return tuple(
        Band(float(low), float(high), int(m) + 1, float(share))
        for (low, high), m, share in zip(pairwise(edges), modes, shares, strict=True)
    )


def _nodes(problem: Problem, nominal: Fit, predicted: Sequence[ComplexArray], at: int | None):
    """Nodes by what a joint stiffness there explains, the best one's curve, and what must be said about it."""
    structure = problem.forward.structure
    nodes = range(1, structure.n_nodes + 1)
    explained = np.zeros(len(nodes))
    total, best = 0.0, None
    several = False
    for number, (observed, model) in enumerate(zip(problem.observed, predicted, strict=True)):
        run = observed.run
        if run.magnitude_only:
            continue
        columns = run.along_force
        several |= np.count_nonzero(np.abs(model[:, columns]).any(axis=0)) > 1  # a held node tells nothing
        e = np.where(observed.valid, model - np.nan_to_num(run.H), 0.0)[:, columns]
        std = np.where(observed.valid, observed.std, np.inf)[:, columns]
        power = np.sum(np.abs(e / std) ** 2)
        total += float(power)
        for j in nodes:
            toward = _gain(problem, nominal, number) * _column(problem.forward, run, nominal, j)[:, columns]
            if not np.abs(toward).any():
                continue
            weight = 1 / std**2
            norm = np.sum(weight * np.abs(toward) ** 2, axis=1)
            g = np.sum(weight * toward.conj() * e, axis=1) / np.maximum(norm, 1e-300)
            left = np.sum(np.abs((e - toward * g[:, None]) / std) ** 2)
            explained[j - 1] += float(power - left)
            if at in (None, j) and (best is None or power - left > best[0]):
                best = (float(power - left), number, j, g, float(1 - left / max(power, 1e-300)))
    if total <= 0 or best is None:
        return (), None, "No run has a phase: the place cannot be told from a joint stiffness."
    share = np.clip(explained / total, 0.0, 1 - 1e-9)
    odds = share / (1 - share)
    if not several:
        odds = np.ones(len(nodes))
    ranked = tuple(NodeShare(j, float(odds[j - 1] / odds.sum())) for j in nodes)
    remark = "" if several else "One accelerometer: every node explains the gap, only the shape of the curve tells."
    return ranked, _joint(problem, nominal, best), remark


def _gain(problem: Problem, nominal: Fit, number: int) -> float:
    """Factor between the model and a run in an arbitrary unit, as it was fitted; 1 where there is a force."""
    if problem.runs[number].quantity != "acceleration":
        return 1.0
    return float(np.exp(nominal.nu[problem.nuisances.gain][number]))


def _column(forward: Forward, run: Run, nominal: Fit, node: int) -> ComplexArray:
    """(n_freq, n_channels) response of the nominal model to a force at another node."""
    moved = replace(run, excitation_node=node)
    return forward.modal(moved, nominal.k_b).response()


def _joint(problem: Problem, nominal: Fit, best) -> JointStiffness:
    """dZ at the best node, and the law it resembles most."""
    _, number, node, g, explained = best
    run = problem.runs[number]
    omega = 2 * np.pi * run.frequency_hz
    to_drive, own = (
        problem.forward.receptance(run, nominal.k_b, driven, [node])[:, 0] for driven in (run.excitation_node, node)
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # where neither moves, nothing is told
        Z = g / (to_drive - g * own)
    usable = np.isfinite(Z)
    return JointStiffness(
        node=node,
        support=run.support,
        frequency_hz=tuple(run.frequency_hz[usable].tolist()),
        real=tuple(Z[usable].real.tolist()),
        imag=tuple(Z[usable].imag.tolist()),
        explained=explained,
        order=_order(Z[usable], omega[usable]),
    )


def _order(Z: ComplexArray, omega: FloatArray) -> str:
    """The simple law that is nearest in the median, with its size, in words; none where all leave more than half."""
    if len(Z) < 3:
        return "too few lines to say"
    found = []
    for name, unit, looks, law in LAWS:
        shape = law(omega)
        size = float(np.median((Z * shape.conj()).real / np.abs(shape) ** 2))
        left = float(np.median(np.abs(Z - size * shape)) / max(np.median(np.abs(Z)), 1e-300))
        found.append((left, f"{name} of {_plain(size)} {unit} ({looks})"))
    left, words = min(found)
    return words if left < 0.5 else "none of stiffness, mass, viscous or hysteretic damper alone"


def _plain(size: float) -> str:
    """'0.32', '1.2e+06' with two digits, as '1.2×10⁶'."""
    text = f"{size:.2g}"
    if "e" not in text:
        return text.replace("-", "−")
    digits, power = text.split("e")
    return f"{digits}{ten_to(int(power))}".replace("-", "−")
