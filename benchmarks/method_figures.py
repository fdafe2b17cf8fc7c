"""Figures of docs/diagnosis-method.md: ``python -m benchmarks.method_figures`` writes docs/figures/method_*.png.

Two stored campaigns of ROSS rotors are diagnosed stage by stage: one with a mass of 80 g at node 4 that the model does
not know, and one without any gap. The place of a gap is shown on the example of docs/diagnosis.md, the force laws on a
rotor on hardening bearings. It takes two minutes.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path
from unittest import mock

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from PIL import Image

from benchmarks.page import COLOURS, DOCS
from rigtwin.gap.answer.held_out import measure_shrink
from rigtwin.gap.answer.where import locate
from rigtwin.gap.audit.checked_run import checked_runs
from rigtwin.gap.audit.findings import audit, usable
from rigtwin.gap.audit.noise import estimate_noise
from rigtwin.gap.audit.wild import LIMITS, wild_lines
from rigtwin.gap.curves import nrmse
from rigtwin.gap.document import Shrink, Where
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import PRIORS, candidates
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.campaign_model import forward_of
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.linear import MODES, Modal
from rigtwin.gap.model.motions import FINE
from rigtwin.gap.model.nonlinear import NonlinearModal
from rigtwin.gap.prepare import prepared
from rigtwin.gap.search import linear, race
from rigtwin.gap.search.nominal import fit_lines_alike
from rigtwin.gap.search.race import Search, Stage
from rigtwin.gap.search.starts import Start
from rigtwin.gap.verdict.adequacy import judge, whitened
from rigtwin.gap.verdict.standing import strain
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.effects import BearingCubic
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Campaign, Channel, NominalBelief, Run
from rigtwin.sim.campaign_folder import load_campaign

STORED = Path(__file__).resolve().parent / "stored_campaigns"
BLUE, RED, GREEN, PINK, ORANGE, SKY = COLOURS
GREY = "0.55"
PIXELS_PER_INCH = 110
SHADES = 128  # colours of a figure, so that its file is small

SEEN_NODE = 3  # channel that curves are drawn of
COARSE_STEP_HZ = 0.2  # of a raster that misses peaks
SPOILED = 1.15  # factor on the one line that is made wild
SPOILED_HZ = 250.0  # near which that line is
CUBIC = BearingCubic(stiffness=3e14)  # N/m^3, bends the first peak by some Hz
CUBIC_K_B = 1.3e6  # N/m
DAMPED = NominalBelief(shaft_damping_ratio=0.003, bearing_damping_Ns_per_m=50.0)
LEVELS_N = (0.2, 0.6, 2.0)
SHOWN_TOLERANCE = 1e-3  # relative
STRETCHES = 10  # of lines of a run, every second one held out
MOTIONS_M = (1e-6, 100e-6)  # of a bearing, that are shown
HIDDEN_KG = 0.06  # mass that the campaign of docs/diagnosis.md hides
HIDDEN_NODE = 5
_LEAST_SHOWN = 0.1  # of a criterion over its threshold


@dataclass(frozen=True)
class Step:
    """One fit of the race."""

    stage: Stage
    start: Start
    fit: Fit | None


@dataclass(frozen=True)
class Example:
    """A stored campaign and its linear search."""

    name: str
    campaign: Campaign
    problem: Problem
    nominal: Fit
    found: Search
    steps: tuple[Step, ...]

    @cached_property
    def said(self) -> Fit:
        """The nominal model that the answer speaks of."""
        return fit_lines_alike(self.problem, self.nominal)

    @property
    def bearing_run(self) -> int:
        """Place of the run on bearings."""
        return [run.support for run in self.problem.runs].index("bearing")

    @property
    def channel(self) -> int:
        """Place of the channel that curves are drawn of."""
        return [channel.node for channel in self.problem.runs[self.bearing_run].channels].index(SEEN_NODE)


def main() -> None:
    """Draw and write every figure."""
    laws_figure()
    evidence_figure(searched("ross_nothing"))
    mass = searched("ross_mass")
    audit_figure(mass)
    model_figure(mass)
    race_figure(mass)
    verdict_figure(mass)
    where_figure(hidden_mass())
    shrink_figure(mass)


def searched(name: str) -> Example:
    """A stored campaign with every fit of its race."""
    campaign = usable(load_campaign(STORED / name / "measured"))
    problem, nominal = prepared(campaign)
    steps: list[Step] = []
    fit_of = race.fitted

    def recorded(problem: Problem, stage: Stage, start: Start) -> Fit | None:
        fit = fit_of(problem, stage, start)
        steps.append(Step(stage, start, fit))
        return fit

    with mock.patch.object(race, "fitted", recorded):
        found = linear.search(problem, candidates(problem.runs, problem.forward.structure), nominal)
    return Example(name, campaign, problem, nominal, found, tuple(steps))


def panels(columns: int, height: float = 3.9) -> tuple[Figure, list[Axes]]:
    """Panels side by side in the page's width."""
    figure, axes = plt.subplots(1, columns, figsize=(10.0, height), layout="constrained", squeeze=False)
    for each in axes[0]:
        each.grid(visible=True, color="0.9", linewidth=0.6)
        each.set_axisbelow(True)
        each.spines[["top", "right"]].set_visible(False)
    return figure, list(axes[0])


def plain_ticks(axis: Axis) -> None:
    """Numbers as they are said, not powers of ten."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def save(figure: Figure, name: str) -> None:
    """Write docs/figures/method_<name>.png."""
    path = DOCS / "figures" / f"method_{name}.png"
    drawn = BytesIO()
    figure.savefig(drawn, dpi=PIXELS_PER_INCH)
    plt.close(figure)
    Image.open(drawn).convert("RGB").quantize(SHADES).save(path, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


def title_of(fit: Fit) -> str:
    """'Attached mass, node 4' of a single effect."""
    (term,) = fit.hypothesis.terms
    node = dict(term.fixed).get("node")
    return EFFECTS[term.effect.id].title + (f", node {node:.0f}" if node else "")


# -- audit -------------------------------------------------------------------------------------------


def audit_figure(example: Example) -> None:
    """A raster that is too coarse for a peak, and a line that does not go with its neighbours."""
    figure, (left, right) = panels(2, 4.4)
    draw_coarse_raster(left, example)
    draw_wild_line(right, example)
    save(figure, "audit")


def draw_coarse_raster(axes: Axes, example: Example) -> None:
    run = example.problem.runs[example.bearing_run]
    best = example.found.best
    peak = example.problem.modals(best.k_b, best.effects)[example.bearing_run].frequencies_hz[0]
    fine = np.linspace(peak - 1.3, peak + 1.3, 801)
    coarse = np.arange(run.frequency_hz[0], run.frequency_hz[-1], COARSE_STEP_HZ)
    on_fine, on_coarse = (settled(example, run, best, lines) for lines in (fine, coarse))
    finding = next(f for f in audit(replace(example.campaign, runs=(on_coarse,))) if f.check == "raster")
    (p,) = checked_runs((on_coarse,))
    width = p.half_power_hz(p.resonances[0], example.campaign.nominal)
    axes.axvspan(peak - width / 2, peak + width / 2, color=ORANGE, alpha=0.35, label="half-power band", linewidth=0)
    axes.plot(fine, np.abs(on_fine.H[:, example.channel]), color=GREY, label="what the rotor does")
    near = np.abs(coarse - peak) < 1.3
    axes.plot(coarse[near], np.abs(on_coarse.H[near, example.channel]), "o-", color=BLUE, label="what the lines show")
    axes.set(xlabel="frequency, Hz", ylabel=f"|acceleration / force| at node {SEEN_NODE}, (m/s²)/N")
    axes.set_title("Raster: too few lines inside the peak", loc="left", fontsize=11)
    axes.legend(frameon=False, loc="upper left", fontsize=9)
    axes.set_xlim(peak - 1.3, peak + 1.3)
    words = textwrap.fill(f"Finding: {finding.words}", 62)
    axes.text(0.0, -0.19, words, transform=axes.transAxes, fontsize=8.5, va="top", color="0.25")


def settled(example: Example, run: Run, fit: Fit, lines: FloatArray) -> Run:
    """A run on other lines, as a fitted model has it without noise."""
    there = replace(
        run,
        frequency_hz=lines,
        H=np.zeros((len(lines), len(run.channels)), dtype=complex),
        std=None,
        harmonics={},
        swept_hz=None,
    )
    return replace(there, H=example.problem.forward.modal(there, fit.k_b, fit.effects).response())


def draw_wild_line(axes: Axes, example: Example) -> None:
    run = example.problem.runs[example.bearing_run]
    H = run.H.copy()
    H[np.argmin(np.abs(run.frequency_hz - SPOILED_HZ))] *= SPOILED
    spoiled = replace(run, H=H)
    noise, wild = estimate_noise(spoiled), wild_lines(spoiled)
    with np.errstate(all="ignore"):
        error = np.nanmax(noise.draws / noise.std, axis=1)
    axes.plot(run.frequency_hz[~wild], error[~wild], ".", color=BLUE, label="lines")
    axes.plot(run.frequency_hz[wild], error[wild], "X", color=RED, markersize=9, label="left out")
    axes.axhline(LIMITS.errors, color=RED, linestyle="--", linewidth=1, label="threshold of a wild line")
    axes.set(xlabel="frequency, Hz", ylabel="distance to the local curve, std errors", yscale="log")
    axes.set_ylim(0.4, 150)
    plain_ticks(axes.yaxis)
    axes.set_title(f"Wild line: one line was multiplied by {SPOILED:g}", loc="left", fontsize=11)
    axes.legend(frameon=False, fontsize=9)


# -- model -------------------------------------------------------------------------------------------


def model_figure(example: Example) -> None:
    """What each resonance adds to a response, and what drifts and tolerances do to a peak."""
    figure, (left, right) = panels(2)
    best, problem = example.found.best, example.problem
    modal = problem.modals(best.k_b, best.effects)[example.bearing_run]
    assert isinstance(modal, Modal)
    none = np.zeros(MODES), modal.anchor
    parts, f = np.abs(modal.of_resonances(*none)[:, :, example.channel]), modal.run.frequency_hz
    for m, colour in zip(range(3), (BLUE, GREEN, PINK), strict=True):
        left.plot(
            f, parts[m], color=colour, linewidth=1.4, label=f"resonance {m + 1}, {modal.frequencies_hz[m]:.1f} Hz"
        )
    left.plot(f, np.abs(modal.response()[:, example.channel]), color="black", linewidth=1.0, label="sum of all")
    left.set(
        xlabel="frequency, Hz",
        ylabel=f"|acceleration / force| at node {SEEN_NODE}, (m/s²)/N",
        yscale="log",
        ylim=(1e-4, 1e2),
    )
    left.set_title("A response is a sum of resonances", loc="left", fontsize=11)
    left.legend(frameon=False, fontsize=9, loc="lower right")
    draw_tolerances(right, example, best)
    save(figure, "model")


def draw_tolerances(axes: Axes, example: Example, best: Fit) -> None:
    """Relative change of the response near the first resonance, beside the noise."""
    run, place = example.problem.runs[example.bearing_run], example.channel
    peak = example.problem.modals(best.k_b, best.effects)[example.bearing_run].frequencies_hz[0]
    fine = settled(example, run, best, np.linspace(peak * 0.97, peak * 1.03, 601))
    modal = example.problem.forward.modal(fine, best.k_b, best.effects)
    assert isinstance(modal, Modal)
    still, names = modal.anchor, example.problem.forward.workshop.names
    one = dict(zip(names, still + SHOWN_TOLERANCE * np.eye(len(names)), strict=True))
    drift = example.campaign.nominal.expected_drift
    curves = [
        ("span", BLUE, modal.response(None, one["span"])),
        ("modulus", RED, modal.response(None, one["modulus"])),
        ("mass of the first disk", GREEN, modal.response(None, one["disk_mass_1"])),
        ("drift of the resonance", ORANGE, modal.response(np.full(MODES, drift), still)),
    ]
    before = modal.response()[:, place]
    for label, colour, H in curves:
        change = np.abs(H[:, place] / before - 1)
        axes.plot(fine.frequency_hz, 100 * change, color=colour, label=label, linewidth=1.3)
    noise = float(np.nanmedian(estimate_noise(run).relative[place]))
    axes.axhline(100 * noise, color="black", linestyle="--", linewidth=1, label="noise of a line")
    axes.set(xlabel="frequency, Hz", ylabel="change of the response, %", yscale="log", ylim=(0.1, 300))
    axes.set_title("Tolerances change a peak by more than the noise", loc="left", fontsize=11)
    words = f"+ 0.1 %, drift + {100 * drift:g} %"
    axes.legend(frameon=False, fontsize=9, loc="upper right", title=words, title_fontsize=9)
    plain_ticks(axes.yaxis)


# -- force laws --------------------------------------------------------------------------------------


def laws_figure() -> None:
    """Hardening bearings at three force levels, and the law as the runs tell it."""
    figure, (left, right) = panels(2)
    forward = forward_of(Campaign("hardening bearings", "nit-rourkela", nominal=DAMPED)).made(resolution=FINE)
    for level, colour, size in zip(LEVELS_N, (BLUE, GREEN, RED), (10, 6, 3), strict=True):
        for sweep in ("down", "up"):
            run = swept(forward, level, sweep)
            label = f"{level:g} N" if sweep == "up" else None
            style = "-" if sweep == "up" else ":"
            left.plot(run.frequency_hz, np.abs(run.H[:, 1]), style, color=colour, label=label, linewidth=1.3)
        motion, force = told(forward, run)
        right.plot(
            1e6 * motion,
            force,
            "o",
            color=colour,
            markersize=size,
            fillstyle="none",
            label=f"lines of the run at {level:g} N",
        )
    x = np.geomspace(*MOTIONS_M, 200)
    law = "law that was put in: ¾ k₃ x³"
    right.plot(1e6 * x, 0.75 * CUBIC.stiffness * x**3, color="black", linewidth=1, label=law)
    left.set(xlabel="frequency, Hz", ylabel="|acceleration / force| at node 4, (m/s²)/N", yscale="log")
    left.set_title("Per newton, each level has another curve", loc="left", fontsize=11)
    left.legend(frameon=False, fontsize=9, title="upwards; dotted: downwards", title_fontsize=9)
    right.set(xlabel="motion of a bearing, µm", ylabel="force beyond the linear one, N", xscale="log", yscale="log")
    right.set(xlim=(1e6 * MOTIONS_M[0], 1e6 * MOTIONS_M[1]), ylim=(1e-4, 1e3))
    left.set_ylim(0.4, 80)
    for axis in (left.yaxis, right.xaxis, right.yaxis):
        plain_ticks(axis)
    right.set_title("Read from the runs, the levels share one law", loc="left", fontsize=11)
    right.legend(frameon=False, fontsize=9, loc="upper left")
    save(figure, "laws")


def swept(forward: Forward, level: float, sweep: str) -> Run:
    """A run on hardening bearings as harmonic balance follows the sweep."""
    lines = np.linspace(66.0, 92.0, 261)
    channels = (Channel(2), Channel(4), Channel(6))
    H = np.zeros((len(lines), len(channels)), dtype=complex)
    run = Run(lines, H, channels, "bearing", force_amplitude_N=level, sweep=sweep)  # type: ignore[arg-type]
    modal = forward.made(with_data=False).modal(run, CUBIC_K_B, (CUBIC,))
    return replace(run, H=modal.response())


def told(forward: Forward, run: Run) -> tuple[FloatArray, FloatArray]:
    """(n_freq,) motion of a bearing [m] and the force of its law [N], as the run tells them without knowing the law."""
    modal = forward.modal(run, CUBIC_K_B, (CUBIC,))
    assert isinstance(modal, NonlinearModal)
    joints, toward, without = modal.read_joints(np.zeros(MODES), modal.anchor)
    force = np.array([np.linalg.lstsq(A, b, rcond=1e-3)[0] for A, b in zip(toward, without - run.H, strict=True)])
    return np.abs(joints[:, 1, 0]), np.abs(force[:, 0])


# -- evidence ----------------------------------------------------------------------------------------


def evidence_figure(example: Example) -> None:
    """Of a campaign without a gap: what rivals gain by fitting and lose by their numbers and their priors."""
    figure, (axes,) = panels(1, 4.5)
    first = race.first_of_each(example.found.fits, lambda fit: fit.hypothesis.ids)[:9][::-1]
    rows = np.arange(len(first))
    own = terms(example.nominal)
    gains = np.array([np.subtract(terms(fit), own) for fit in first])
    names = (
        "better fit (right) or worse (left)",
        "Occam's penalty for the extra numbers",
        "prior of this effect at this place",
    )
    for k, (name, colour) in enumerate(zip(names, (GREEN, RED, ORANGE), strict=True)):
        axes.barh(rows + 0.25 * (1 - k), gains[:, k], 0.24, color=colour, label=name)
    axes.plot(gains.sum(axis=1), rows, "D", color="black", label="sum: logarithm of the odds against no gap")
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(rows, [title_of(fit) for fit in first])
    axes.set(xlabel="natural logarithm, relative to the nominal model")
    axes.set_title(
        "A rotor without a gap: no effect fits so much better that it pays for its numbers and its prior",
        loc="left",
        fontsize=11,
    )
    figure.legend(frameon=False, fontsize=9, loc="outside lower center", ncols=2)
    save(figure, "evidence")


def terms(fit: Fit) -> tuple[float, float, float]:
    """Parts of the logarithm of a candidate's weight: fit, Occam's, prior."""
    by_fit = -fit.cost / 2
    prior = np.log(fit.hypothesis.prior * (1 - PRIORS.no_gap)) if fit.hypothesis.terms else np.log(PRIORS.no_gap)
    return by_fit, fit.log_evidence() - by_fit, float(prior)


# -- race --------------------------------------------------------------------------------------------


def race_figure(example: Example) -> None:
    """Misfit of every start over the stages of the race, relative to the best one."""
    figure, (axes,) = panels(1, 4.2)
    stages = list(dict.fromkeys(step.stage for step in example.steps))
    begun = {id(step.start.u) for step in example.steps}
    before = {id(step.start.u): cost for step, cost in _begin(example, stages[0])}
    for k, stage in enumerate(stages, start=1):
        steps = [(step, step.fit) for step in example.steps if step.stage == stage and step.fit]
        best = min(fit.cost for _, fit in steps)
        for step, fit in steps:
            goes_on = id(fit.u) in begun or k == len(stages)
            size = fit.cost / best
            axes.plot([k - 1, k], [before[id(step.start.u)], size], color=GREY, linewidth=0.8, zorder=1)
            axes.plot(k, size, "o" if goes_on else "X", color=GREEN if goes_on else RED, markersize=7)
            before[id(fit.u)] = size
        for name, size in _best_of_each(steps, best, 3 if k == 1 else 2):
            axes.annotate(name, (k, size), (7, 3), textcoords="offset points", fontsize=8.5)
    names = [f"{stage.steps} steps more,\n{_error(stage)}" for stage in stages]
    names[0] = names[0].replace("1 steps more", "1 step")
    axes.set_xticks(range(len(stages) + 1), ["starts,\nerror of 10 % added", *names])
    axes.set(yscale="log", ylabel="misfit over the best one's", ylim=(0.8, None), xlim=(-0.2, len(stages) + 0.55))
    axes.plot([], [], "o", color=GREEN, label="goes on")
    axes.plot([], [], "X", color=RED, label="drops out")
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    plain_ticks(axes.yaxis)
    count = len([step for step in example.steps if step.stage == stages[0]])
    axes.set_title(f"A race of {count} starts; the right one is the mass at node 4", loc="left", fontsize=11)
    save(figure, "race")


def _begin(example: Example, stage: Stage) -> list[tuple[Step, float]]:
    """The first steps and what their starts leave over what the best one does."""
    first = [step for step in example.steps if step.stage == stage]
    costs = [example.problem.cost(s.start.hypothesis, s.start.u, s.start.nu, stage.added) for s in first]
    return [(step, cost / min(costs)) for step, cost in zip(first, costs, strict=True)]


def _best_of_each(steps: Sequence[tuple[Step, Fit]], best: float, count: int) -> list[tuple[str, float]]:
    """The best fit of each candidate by name, with its misfit over the best one's."""
    ordered = sorted((fit for _, fit in steps), key=lambda fit: fit.cost)
    return [(title_of(fit), fit.cost / best) for fit in race.first_of_each(ordered, title_of)[:count]]


def _error(stage: Stage) -> str:
    return f"error of {100 * stage.added:g} % added" if stage.added else "the data's own errors"


# -- verdict -----------------------------------------------------------------------------------------


def verdict_figure(example: Example) -> None:
    """Residuals before and after, and the criteria of adequacy over their thresholds."""
    figure, (left, right) = panels(2)
    rival = min((step.fit for step in example.steps if step.fit and "crack" in title_of(step.fit)), key=_cost)
    rival = example.problem.fit(rival.hypothesis, rival.u, rival.nu, anneal=(0.02, 0.0))
    fits = [("nominal model", example.nominal, RED), (f"rival: {title_of(rival).lower()}", rival, ORANGE)]
    fits.append((f"cause: {title_of(example.found.best).lower()}", example.found.best, GREEN))
    for label, fit, colour in fits:
        observed = example.problem.observed[example.bearing_run]
        z = whitened(observed, example.problem.predict(fit)[example.bearing_run])
        size = np.sqrt(np.nanmean(np.abs(z) ** 2, axis=1) / 2)
        left.plot(observed.run.frequency_hz, size, ".", color=colour, markersize=4, label=label)
    left.axhline(1, color="black", linewidth=0.9, label="noise alone")
    left.set(xlabel="frequency, Hz", ylabel="residual of a line, standard errors", yscale="log", ylim=(0.4, 60))
    plain_ticks(left.yaxis)
    left.set_title("What each model leaves of the run on bearings", loc="left", fontsize=11)
    left.legend(frameon=False, fontsize=9, loc="upper right")
    draw_criteria(right, example, fits)
    save(figure, "verdict")


def _cost(fit: Fit) -> float:
    return fit.cost


def draw_criteria(axes: Axes, example: Example, fits: Sequence[tuple[str, Fit, str]]) -> None:
    """Each criterion of adequacy over its threshold, of several fits."""
    names = ("misfit", "correlation of\nneighbouring lines", "strain of the\nnuisances")
    for row, (_, fit, colour) in enumerate(fits):
        quality = judge(example.problem, fit)
        values = (
            (quality.misfit - 1) / (THRESHOLDS.adequate_misfit - 1),
            quality.correlation / THRESHOLDS.adequate_correlation,
            strain(example.problem, fit),
        )
        places = np.arange(3) + 0.25 * (row - 1)
        axes.barh(places, np.maximum(values, _LEAST_SHOWN), 0.22, color=colour)
        for place, value in zip(places, values, strict=True):
            words = f"{value:.0f}" if value > 1 else f"{value:.1f}" if value > 0 else "below zero"
            axes.text(1.1 * max(value, _LEAST_SHOWN), place, words, va="center", fontsize=9)
    axes.axvline(1, color="black", linewidth=0.9)
    axes.set_yticks(range(3), names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="criterion over its threshold", xlim=(_LEAST_SHOWN, 3000))
    plain_ticks(axes.xaxis)
    axes.set_title("Left of the line a model is adequate", loc="left", fontsize=11)


# -- answer ------------------------------------------------------------------------------------------


def where_figure(example: Example) -> None:
    """Shares of the gap by band and by node, and the joint stiffness of the best node."""
    figure, (bands, nodes, joint) = panels(3, 3.6)
    where = locate(example.problem, example.said, example.problem.recalibrated(example.said), "linear")
    labels = [f"{band.f_lo:.0f} to {band.f_hi:.0f} Hz" for band in where.bands]
    bands.bar(labels, [100 * band.share for band in where.bands], color=BLUE, width=0.6)
    bands.set(ylabel="share of the gap, %", xlabel="band with one resonance")
    bands.set_title("By frequency", loc="left", fontsize=11)
    nodes.bar([f"{each.node}" for each in where.nodes], [100 * each.share for each in where.nodes], color=BLUE)
    nodes.set(ylabel="share of the gap, %", xlabel="node")
    nodes.set_title("By place", loc="left", fontsize=11)
    draw_joint(joint, where)
    save(figure, "where")


def hidden_mass() -> Example:
    """The campaign of docs/diagnosis.md, measured on the virtual rig, without a search."""
    with tempfile.TemporaryDirectory() as folder:
        tables = ['rig = "nit-rourkela"']
        for support in ("rigid", "bearing"):
            effect = ["--effect", "attached_mass", "--set", f"attached_mass.mass={HIDDEN_KG}"]
            effect += ["--set", f"attached_mass.node={HIDDEN_NODE}", "--set", "k_b=2e6", "--noise", "0.01"]
            out = ["--support", support, "--out", str(Path(folder) / f"{support}.csv")]
            subprocess.run([sys.executable, "-m", "rigtwin", "sweep", *effect, *out], check=True)
            tables.append(f'[[run]]\nfile = "{support}.csv"\nsupport = "{support}"')
        (Path(folder) / "campaign.toml").write_text("\n\n".join(tables), encoding="utf-8")
        campaign = usable(load_campaign(folder))
    problem, nominal = prepared(campaign)
    return Example("hidden mass", campaign, problem, nominal, Search(nominal, ()), ())


def draw_joint(axes: Axes, where: Where) -> None:
    found = where.joint
    assert found is not None
    f = np.array(found.frequency_hz)
    axes.plot(f, np.array(found.real) / 1e3, ".", color=BLUE, markersize=4, label="real part, read line by line")
    axes.plot(f, np.array(found.imag) / 1e3, ".", color=ORANGE, markersize=4, label="imaginary part")
    axes.plot(f, -((2 * np.pi * f) ** 2) * HIDDEN_KG / 1e3, color="black", linewidth=1, label=f"−ω² · {HIDDEN_KG:g} kg")
    most = (2 * np.pi * f[-1]) ** 2 * HIDDEN_KG / 1e3
    axes.set(xlabel="frequency, Hz", ylabel="dynamic stiffness, kN/m", ylim=(-1.6 * most, 0.4 * most))
    axes.set_title(f"What acts at node {found.node}", loc="left", fontsize=11)
    axes.legend(frameon=False, fontsize=8.5, loc="lower left")


def shrink_figure(example: Example) -> None:
    """Held-out stretches of a run, and how far the gap shrinks there and where another node is driven."""
    figure, (left, right) = panels(2, 4.2)
    shrink = measure_shrink(example.problem, example.said, example.found.best, 1.0, None)
    run, place = example.problem.runs[example.bearing_run], example.channel
    lines = 1 + np.arange(len(run.frequency_hz))
    held = (np.arange(len(lines)) * STRETCHES // len(lines)) % 2 == 1
    left.fill_between(lines, 0, 1, where=held.tolist(), transform=left.get_xaxis_transform(), color="0.92", linewidth=0)
    left.plot(lines, np.abs(run.H[:, place]), ".", color="black", markersize=4, label="measured")
    for label, fit, colour in (("nominal", example.said, RED), ("corrected", example.found.best, GREEN)):
        H = example.problem.recalibrated(fit)[example.bearing_run]
        left.plot(lines, np.abs(H[:, place]), color=colour, linewidth=1.1, label=f"{label} model")
    left.set(xlabel="number of the line, 20 to 400 Hz", yscale="log")
    left.set_ylabel(f"|acceleration / force| at node {SEEN_NODE}, (m/s²)/N")
    left.set_title("Every second stretch of lines (grey) is held out", loc="left", fontsize=11)
    left.legend(frameon=False, fontsize=9, loc="upper right")
    draw_shrink(right, example, shrink)
    save(figure, "shrink")


def draw_shrink(axes: Axes, example: Example, shrink: Shrink) -> None:
    """Gaps before and after on held-out lines, and the interval beside what came true at another node."""
    assert shrink.after_model is not None
    assert shrink.without_effect is not None
    names = ("before", "gains and tolerances\nalone", "after", "noise alone")
    gaps = (shrink.before, shrink.without_effect, shrink.after_model, shrink.floor)
    bars = axes.barh(names, [100 * gap for gap in gaps], color=(RED, ORANGE, GREEN, GREY), height=0.6)
    axes.bar_label(bars, fmt="%.2g %%", padding=4, fontsize=9)
    axes.invert_yaxis()
    axes.set(xlabel="gap on the held-out lines, %", xscale="log", xlim=(0.3, 400))
    plain_ticks(axes.xaxis)
    low, high = shrink.ci90
    words = f"Explainable shrink {100 * shrink.explainable:.1f} %. With another node driven, {100 * low:.1f} % to "
    words += f"{100 * high:.1f} % is predicted, and the stored runs show {100 * came_true(example):.1f} %."
    axes.text(0.0, -0.19, textwrap.fill(words, 62), transform=axes.transAxes, fontsize=9, va="top", color="0.25")
    axes.set_title("How far the gap shrinks", loc="left", fontsize=11)


def came_true(example: Example) -> float:
    """Shrink of the noise-free gap in the stored runs with another node driven."""
    folder = STORED / example.name
    best, before, after = example.found.best, [], []
    with np.load(folder / "truth" / "held_out.npz") as truth:
        for run in load_campaign(folder / "held_out").runs:
            ideal = truth[f"{run.name}/ideal"][:, [channel.node - 1 for channel in run.channels]]
            forward = example.problem.forward
            plain = forward.modal(run, example.said.k_b).response()
            tolerance = best.nu[example.problem.nuisances.tolerance]
            corrected = forward.modal(run, best.k_b, best.effects).response(None, tolerance)
            before.append(nrmse(ideal, plain))
            after.append(nrmse(ideal, corrected))
    return 1 - float(np.mean(after)) / float(np.mean(before))


if __name__ == "__main__":
    main()
