"""The diagnosis of a campaign: where the gap to its model lies, and what causes it."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from rigtwin.api.fmus import rotor_fmu
from rigtwin.api.rigs import effect_of, refuse_tables
from rigtwin.errors import UserError, existing, for_users
from rigtwin.gap.curves import Curve
from rigtwin.gap.document import FILE_NAME as DIAGNOSIS_FILE
from rigtwin.gap.document import Cause, Diagnosis, DocumentError
from rigtwin.gap.phrases import part
from rigtwin.pages.diagnosis_page import FILE_NAME as PAGE_FILE
from rigtwin.pages.diagnosis_page import write_diagnosis_page
from rigtwin.pages.diagnosis_words import cause_title, k_b_words, parameters, places
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model import html
from rigtwin.rotor.model.arrays import ComplexArray
from rigtwin.scale_out import executor
from rigtwin.scratch import replacing
from rigtwin.sim.campaign import Campaign, Run
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.session import FmuSession
from rigtwin.sim.setup import SetupError
from rigtwin.sim.stepped_sine import Rig, SweepPlan, measure_lines

logger = logging.getLogger(__name__)

# Called with (done, total, words).
Progress = Callable[[int, int, str], None]

# Candidates that are shown in short; the page and the JSON hold all.
FOREMOST = 5

CAUSE_HEADER = ("cause", "where", "probability", "size", "k_b, MN/m")


def cause_row(cause: Cause) -> tuple[str, ...]:
    """A candidate for a reader, beneath CAUSE_HEADER."""
    size = ", ".join(parameters(cause))
    return cause_title(cause), places(cause), part(cause.probability), size, k_b_words(cause.k_b)


@dataclass(frozen=True)
class Diagnosed:
    """A campaign with its diagnosis."""

    campaign: Campaign
    diagnosis: Diagnosis  # all of it: verdict, where, causes, shrink, next_test, audit, ...
    curves: tuple[Curve, ...] = ()  # each run beside the nominal and the corrected model

    @property
    def verdict(self) -> str:
        """ "no_gap", "cause", "ambiguous", "unknown" or "not_enough_data"."""
        return self.diagnosis.verdict

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        return self.diagnosis.sentence

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Every candidate, the most probable one first."""
        return self.diagnosis.causes

    @property
    def k_b(self) -> float | None:
        """Bearing stiffness [N/m]: with the cause, where one is named; None where no run on bearings tells it."""
        known = self.causes[0].k_b if self.diagnosis.names_a_cause else self.diagnosis.nominal.get("k_b")
        return known.value if known else None

    def save(self, folder: str | Path) -> Path:
        """Write diagnosis.json and report.html into a folder, both or neither; returns the page. Raises UserError."""
        return _save(self, Path(folder))

    def __str__(self) -> str:
        """The verdict in a sentence."""
        return self.sentence

    def _repr_html_(self) -> str:
        drawn = _drawing(self.curves[-1]) if self.curves else ""
        table = html.table(CAUSE_HEADER, [cause_row(cause) for cause in self.causes[:FOREMOST]])
        return html.paragraph(self.sentence) + drawn + table


def _drawing(curve: Curve) -> str:
    """A run beside its models, at the channel that moves most."""
    run, place = curve.run, curve.run.channels.index(curve.run.loudest)
    lines = [html.Line(run.frequency_hz, np.abs(run.H[:, place]), f"measured, {run.name}")]
    lines.append(html.Line(run.frequency_hz, np.abs(curve.nominal[:, place]), "nominal model", "#888888", "5 4"))
    if curve.corrected is not None:
        lines.append(html.Line(run.frequency_hz, np.abs(curve.corrected[:, place]), "corrected model", "#d55e00"))
    return html.curves(lines, "frequency, Hz", f"{run.quantity}, {run.loudest}")


@for_users
def _save(found: Diagnosed, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / PAGE_FILE
    with replacing(folder / DIAGNOSIS_FILE) as document:  # both files are new, or neither
        document.write_text(found.diagnosis.to_json(), encoding="utf-8")
        write_diagnosis_page(found.diagnosis, found.curves, found.campaign, page)
    return page


@for_users
def diagnose(
    campaign: Campaign | str | Path,
    *,
    exclude: Sequence[str] = (),
    fmu: bool = True,
    workers: int | None = 1,
    progress: Progress | None = None,
    time_limit_s: float | None = None,
) -> Diagnosed:
    """Say where the gap between a campaign and its model lies, what causes it, and how far it shrinks.

    Parameters
    ----------
    campaign : as it was loaded, or its folder
    exclude : ids of effects that are withheld from the library
    fmu : whether the corrected rotor is measured on the virtual rig, for the figure after the correction
    workers : processes that share the fits, this one among them; None: one for each core. Scripts that use more than
        one need ``if __name__ == "__main__":``, because the others import them. The answer does not depend on it.
    progress : called with (done, total, words)
    time_limit_s : seconds of processor time after which no further candidate is tried, and a warning in the audit
        says so; default 300, or 60 where the audit finds wrong names, signs or units

    Returns
    -------
    Diagnosed, whose ``diagnosis`` has everything that stands in diagnosis.json

    Raises
    ------
    UserError : the campaign cannot be used, or there is no such effect

    >>> import numpy as np, rigtwin
    >>> lines = np.arange(60.0, 110.0, 0.5)
    >>> runs = [rigtwin.model_response("nit-rourkela", lines, k_b=5e6, support=s) for s in ("rigid", "bearing")]
    >>> rigtwin.diagnose(rigtwin.Campaign("a test", "nit-rourkela", tuple(runs)), exclude=["open_crak"])
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: --exclude: there is no effect 'open_crak'; did you mean open_crack? ...
    """
    from rigtwin.gap.diagnose import diagnose as find_gap

    exclude = _known(exclude)
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(campaign)
    refuse_tables(load_rig(campaign.rig), "a diagnosis")
    confirm = partial(_confirmed_if_possible, campaign, progress=progress) if fmu else None
    with shared_among(workers if campaign.runs else 1) as helpers:  # lists of resonances need no fits
        outcome = find_gap(
            campaign, exclude=exclude, progress=progress, confirm=confirm, helpers=helpers, seconds=time_limit_s
        )
    return Diagnosed(campaign, outcome.diagnosis, outcome.curves)


def _known(effect_ids: Sequence[str]) -> tuple[str, ...]:
    """The effects to leave out, each once. Raises UserError where there is no such effect."""
    try:
        return tuple(dict.fromkeys(effect_of(effect_id).id for effect_id in effect_ids))
    except UserError as error:
        raise UserError(f"--exclude: {error}") from None


@contextmanager
def shared_among(workers: int | None) -> Iterator[Executor | None]:
    """Helpers for ``diagnose``: all processes but this one; they load what they need while the audit goes on."""
    others = (workers or os.cpu_count() or 1) - 1
    if others < 1:
        yield None
        return
    with executor(workers=others) as pool:
        for _ in range(others):
            pool.submit(_load)
        yield pool


def _load() -> None:
    import rigtwin.gap.search.linear  # noqa: F401


@for_users
def load_diagnosis(path: str | Path) -> Diagnosis:
    """What ``rigtwin diagnose`` or ``Diagnosed.save`` wrote into a diagnosis.json.

    Raises
    ------
    UserError : the file is none, or it names effects that do not exist

    >>> import rigtwin
    >>> rigtwin.load_diagnosis("missing.json")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: missing.json: no such file; check its name and folder
    """
    return read_diagnosis(Path(path))


def read_diagnosis(path: Path) -> Diagnosis:
    """A diagnosis.json, its effects known ones. Raises UserError."""
    file = existing(path)
    try:
        diagnosis = Diagnosis.from_json(file.read_text(encoding="utf-8"))
        for number, cause in enumerate(diagnosis.causes, start=1):
            for effect_id in cause.effects:
                _check_effect(number, effect_id)
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not a text file in UTF-8 ({error.reason}); diagnose again") from error
    except (DocumentError, UserError) as error:
        raise UserError(f"{path}: {error}") from error
    return diagnosis


def _check_effect(number: int, effect_id: str) -> None:
    try:
        effect_of(effect_id)
    except UserError as error:
        raise UserError(f"cause {number}: {error}") from error


# -- the virtual rig -----------------------------------------------------------------------------------


def _confirmed_if_possible(
    campaign: Campaign, runs: Sequence[Run], effects: Sequence[Effect], k_b: float, progress: Progress | None
) -> tuple[list[ComplexArray], str]:
    """What the virtual rig measures; nothing where it fails or is interrupted, as the diagnosis itself is finished."""
    try:
        return measured_on_the_virtual_rig(campaign, runs, effects, k_b, progress)
    except KeyboardInterrupt:
        reason = "was interrupted"
    except (RuntimeError, SetupError, UserError, OSError) as error:
        reason = f"does not confirm the cause ({error})"
    logger.warning("the virtual rig %s: the after-figure is the fitting model's own", reason)
    return [], "model"


def measured_on_the_virtual_rig(
    campaign: Campaign, runs: Sequence[Run], effects: Sequence[Effect], k_b: float, progress: Progress | None = None
) -> tuple[list[ComplexArray], str]:
    """Each run measured again without noise, with the effects, on an FMU of the rig with the diagnosis' mesh.

    Parameters
    ----------
    campaign : says the rig, and the damping that the nominal model believes in
    runs : their lines, channels and settings
    effects : those of the rotor are switched on in the FMU, those of the measurement chain act in the sweep
    k_b : stiffness of the bearings [N/m]
    progress : told which run is being measured

    Returns
    -------
    (n_freq, n_channels) of each run, and "fmu", or "rig" where an effect is none of the FMU's
    """
    from rigtwin.gap.model.campaign_model import believed, elements_between_nodes

    rig = load_rig(campaign.rig)
    belief = believed(campaign.nominal, rig)
    parameters = {
        "k_b": k_b,
        "bearing_damping": belief.bearing_damping_Ns_per_m,
        "shaft_damping_ratio": belief.shaft_damping_ratio,
    }
    tell = progress or (lambda *_: None)
    tell(0, len(runs), "virtual rig: building the FMU")
    measured = []
    mesh = elements_between_nodes(rig)
    with rotor_fmu(campaign.rig, elements_between_nodes=mesh) as fmu, FmuSession(fmu) as session:
        for number, run in enumerate(runs):
            tell(number, len(runs), f"virtual rig: run {number + 1} of {len(runs)}")
            measured.append(_measure(session, run, parameters, tuple(effects)))
    return measured, "fmu" if all(effect.family != "chain" for effect in effects) else "rig"


def _measure(session: FmuSession, run: Run, parameters: dict[str, float], effects: tuple[Effect, ...]) -> ComplexArray:
    """(n_freq, n_channels) in the run's own quantity, on its own lines.

    Per force that acts, nothing of a force drop-out is seen.
    """
    if run.quantity != "acceleration":
        effects = tuple(effect for effect in effects if not effect.needs_exciter_current)
    rig = Rig(
        support=run.support,
        excitation_node=run.excitation_node,
        excitation_plane=run.excitation_plane,
        spin_rpm=run.spin_rpm,
        parameters={**parameters},
        effects=effects,
        quantity="acceleration" if run.quantity == "acceleration" else "accelerance",
        sensor_planes=tuple(dict.fromkeys((run.excitation_plane, *(channel.plane for channel in run.channels)))),
    )
    plan = SweepPlan(force_amplitude=run.force_amplitude_N or 1.0, direction=run.sweep or "up")
    swept = run.frequency_hz if run.swept_hz is None else run.swept_hz
    found = measure_lines(session, rig, plan, run.frequency_hz, passing=swept).run
    H = np.column_stack([found.channel(channel.node, channel.plane) for channel in run.channels])
    omega = 2 * np.pi * run.frequency_hz[:, None]
    return H * (1j * omega) ** (DERIVATIVE_ORDER[run.quantity] - DERIVATIVE_ORDER["accelerance"])
