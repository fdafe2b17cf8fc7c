"""Every kind of HTML page, made in seconds from the models alone: no FMU runs and nothing is searched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import rigtwin
from rigtwin.api.fmus import open_estimator
from rigtwin.commands.demo import UNKNOWNS, Demo, Found, write_demo_page
from rigtwin.commands.paper import read_paper
from rigtwin.estimator.features import features_of_runs
from rigtwin.estimator.runtime import shipped_model
from rigtwin.fmu_src.build import rotor_facts
from rigtwin.fmu_src.documentation import estimator_pages, rotor_pages
from rigtwin.gap.document import Diagnosis, Estimate, Finding, FittedJoint, NodeShare, Where
from rigtwin.pages.diagnosis_page import write_diagnosis_page
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Campaign, PeakList, Run
from rigtwin.sim.modal_fit import fit_modes
from tests.rigtwin.test_diagnose_page import BEARINGS, CRACK, DIAGNOSIS, PEDESTAL, SHRINK, campaign_of, curve

RIG = "nit-rourkela"
NOISE = 0.01

# What may stand in a title, a file name or a remark.
EVIL = """</script><script>window.broken = 1</script> <img src=x onerror="window.broken = 1"> "a" 'b' & ${c} -->"""


def measured(k_b: float, support: str, seed: int = 0) -> Run:
    """A run of the model with noise of 1 %, its lines dense at resonances."""
    modes = rigtwin.model_modes(RIG, k_b=k_b, support=support, n_modes=2).frequency_hz  # type: ignore[arg-type]
    dense = [np.round(f, 1) + np.linspace(-2, 2, 81) for f in modes]
    lines = np.unique(np.round(np.concatenate([np.linspace(20, 400, 96), *dense]), 6))
    clean = rigtwin.model_response(RIG, lines, k_b=k_b, support=support)  # type: ignore[arg-type]
    rng = np.random.default_rng(seed)
    std = NOISE * np.abs(clean.H) + 1e-9
    error = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / np.sqrt(2)
    return replace(clean, H=clean.H + error, std=std, name=support)


def campaign(k_b: float, title: str, seed: int = 0) -> Campaign:
    """Both supports."""
    runs = tuple(measured(k_b, support, seed + n) for n, support in enumerate(("rigid", "bearing")))
    return Campaign(title, RIG, runs)


# -- diagnoses ---------------------------------------------------------------------------------------------


def diagnosis_of_a_cause(path: Path, title: str) -> None:
    """Pedestals on two supports and at two levels, with every part that a page can have."""
    curves = curve("rigid", 1.0), curve("bearing", 1.0), curve("bearing", 2.0)
    found = replace(DIAGNOSIS, title=title, where=replace(DIAGNOSIS.where, bearings=BEARINGS))
    found = replace(found, audit=(*found.audit, Finding("level", "error", f"Levels differ. {title}", title)))
    named = tuple(replace(each, run=replace(each.run, name=f"{each.run.name} {title}"[:70])) for each in curves)
    write_diagnosis_page(found, named, campaign_of(named, title), path)


def diagnosis_of_an_unknown_mechanism(path: Path, title: str) -> None:
    """No known effect fits, and the mechanism is located at node 5."""
    curves = curve("rigid", 1.0), curve("bearing", 1.0)
    f = np.linspace(20, 400, 60)
    Z = 2e4 / (1 - (f / 210) ** 2 + 0.02j)
    joint = FittedJoint(
        node=5,
        at_exciter=False,
        parameters={"stiffness": Estimate(2e4, 900.0, "N/m")},
        k_b=Estimate(9.9e6, 4e4, "N/m"),
        nodes=(NodeShare(5, 0.97), NodeShare(4, 0.03)),
        frequency_hz=tuple(f),
        real=tuple(Z.real),
        imag=tuple(Z.imag),
        shrink=SHRINK,
        control=0.12,
    )
    sentence = "No known effect fits; an unknown mechanism acts at node 5 with a stiffness of a resonance at 210 Hz."
    found = replace(
        DIAGNOSIS,
        title=title,
        verdict="unknown",
        sentence=sentence,
        shrink=None,
        causes=(replace(CRACK, probability=0.8), replace(PEDESTAL, probability=0.2)),
        measured_joint=joint,
        unknown_score=0.98,
    )
    write_diagnosis_page(found, curves, campaign_of(curves, title), path)


def diagnosis_of_resonance_lists(path: Path, title: str) -> None:
    """Two peaks, no run."""
    peaks = (PeakList("rigid", np.array([95.0, 320.0]), np.array([1.5, 3.0])),)
    rows = [
        {"support": "rigid", "listed_Hz": 95.0, "std_Hz": 1.5, "nominal_Hz": 100.56, "best_Hz": 95.2},
        {"support": "rigid", "listed_Hz": 320.0, "std_Hz": 3.0, "nominal_Hz": None, "best_Hz": 319.9},
    ]
    fit = {"matched": 1, "unmatched": 1, "not_listed": 0, "parameters": 1, "chi2": 13.7, "degrees_of_freedom": 0,
           "p_value": None, "determined": 1.0}  # fmt: skip
    nominal = {"k_b": None, "gap": None, "peaks": rows, "fit": fit, "best_fit": None}
    both = (replace(PEDESTAL, probability=0.5), replace(CRACK, probability=0.4))
    found = Diagnosis(title, RIG, "ambiguous", "Two causes fit the list.", nominal, Where(), both, equivalent=both)
    write_diagnosis_page(found, (), campaign_of((), title, peaks), path)


# -- other pages -------------------------------------------------------------------------------------------


def report(path: Path, title: str) -> None:
    """Two runs and a list of resonances."""
    runs = campaign(1e7, title)
    listed = PeakList("rigid", np.array([100.5, 324.0]), np.array([0.5, 1.0]))
    rigtwin.report(replace(runs, peaks=(listed,)), out=path)


def comparison(path: Path, title: str) -> None:
    """Two campaigns whose bearings differ."""
    rigtwin.compare(campaign(5e6, title), campaign(4.8e6, f"later: {title}", 10)).save(path)


def prediction(path: Path, title: str) -> None:
    """A campaign that a diagnosis has not seen."""
    found = replace(DIAGNOSIS, calibration=DIAGNOSIS.nominal["calibration"])
    rigtwin.predict(found, campaign(1e7, title)).save(path.parent / path.stem)
    (path.parent / path.stem / "prediction.html").rename(path)


def demo(path: Path, title: str) -> None:
    """The demo of responses that the model gives; its texts are no one's but ours."""
    with open_estimator() as (ask, card):
        found = []
        for place, truth in enumerate(UNKNOWNS):
            rigid, bearing = (measured(truth.k_b, support, place) for support in ("rigid", "bearing"))
            first, second = fit_modes(bearing, 2)
            features = features_of_runs(rigid, bearing)
            found.append(Found(truth, features, ask(features), (first.frequency_hz, second.frequency_hz)))
        runs = measured(1e7, "rigid"), measured(1e7, "bearing")
        write_demo_page(Demo(runs, tuple(found), read_paper(ask, card), ()), path)


def rotor_fmu(path: Path, title: str) -> None:
    """The page inside the rotor FMU."""
    rig = load_rig(RIG).model_copy(update={"title": title})
    path.write_bytes(rotor_pages(rig, rotor_facts(rig, assemble(rig)))["documentation/index.html"])


def estimator_fmu(path: Path, title: str) -> None:
    """The page inside the estimator FMU; its texts are no one's but ours."""
    path.write_bytes(estimator_pages(shipped_model())["documentation/index.html"])


PAGES: dict[str, Callable[[Path, str], None]] = {
    "cause": diagnosis_of_a_cause,
    "unknown": diagnosis_of_an_unknown_mechanism,
    "lists": diagnosis_of_resonance_lists,
    "report": report,
    "comparison": comparison,
    "prediction": prediction,
    "demo": demo,
    "rotor_fmu": rotor_fmu,
    "estimator_fmu": estimator_fmu,
}
