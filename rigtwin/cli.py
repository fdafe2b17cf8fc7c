"""The commands and their options; what they do stands in one module each, imported when it is called."""

from __future__ import annotations

import logging
import os
import sys
from enum import StrEnum
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperCommand

from rigtwin.errors import UserError
from rigtwin.exits import GATE_FAILED, CommandGroup
from rigtwin.interrupt import end_at_the_second
from rigtwin.interrupt import install as install_interrupt
from rigtwin.scale_out import ONE_THREAD, ExecutorOption
from rigtwin.scratch import sweep_leftovers

app = typer.Typer(
    name="rigtwin",
    cls=CommandGroup,
    help="A rotor test rig and its digital twin: FMUs, virtual measurements, bearing stiffness.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    invoke_without_command=True,
)


class Support(StrEnum):
    """How the rotor is held."""

    rigid = "rigid"
    bearing = "bearing"


class Plane(StrEnum):
    """Plane of the force."""

    y = "y"
    z = "z"


class Direction(StrEnum):
    """Order of the lines of a sweep."""

    up = "up"
    down = "down"


class Quantity(StrEnum):
    """What the numbers of a measured run are."""

    receptance = "receptance"
    mobility = "mobility"
    accelerance = "accelerance"
    acceleration = "acceleration"


class Method(StrEnum):
    """How k_b is found."""

    network = "network"
    model = "model"
    responses = "responses"


RIG = "nit-rourkela"

# Upper limits: beyond them a command asks for more memory, time or processes than any machine has for it.
MOST_LINES, MOST_RIGS, MOST_CAMPAIGNS, MOST_WORKERS, MOST_NODES = 100_000, 100_000, 10_000, 1_000, 10_000
JSON = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
RECORDS = ".csv, .txt, .wav, .mat, .h5 or .tdms."
TRUST = Annotated[
    bool, typer.Option("--trust", help="Run an FMU that was built elsewhere; it runs with all your rights.")
]
RUN_SETTING = typer.Option(
    "--set", metavar="KEY=VALUE", help="Key of a [[run]] in campaign.toml, such as support=rigid or unit=g/N; repeat."
)


# Options of the commands that are asked about a rotor.
RIG_ARGUMENT = Annotated[str, typer.Argument(metavar="RIG", help="A rig TOML, or the name of a shipped rig.")]
K_B = Annotated[float | None, typer.Option(help="Bearing stiffness [N/m]; default the rig file's.")]
RIGID = Annotated[bool, typer.Option("--rigid", help="Rigid supports in place of the bearings.")]
BEARING_DAMPING = Annotated[float | None, typer.Option(help="Damping of each bearing [N s/m]; default the rig file's.")]
SHAFT_DAMPING = Annotated[float | None, typer.Option(help="Damping ratio of the shaft; default the rig file's.")]
EFFECTS_ON = Annotated[
    list[str] | None, typer.Option("--effect", metavar="ID", help="Linear effect of the rotor; repeat.")
]
EFFECT_SETTINGS = Annotated[
    list[str] | None, typer.Option("--set", metavar="ID.PARAM=VALUE", help="Parameter of an effect; repeat.")
]
PICTURE = Annotated[Path | None, typer.Option(help="Picture: .png, .svg or .pdf.")]
RPM_MIN = Annotated[
    float | None,
    typer.Option(help="Lowest spin speed [rev/min]; default that of the supports' tables, if there are any."),
]
RPM_MAX = Annotated[
    float | None,
    typer.Option(
        help="Highest spin speed [rev/min]; default a fifth above the fourth critical speed, or the tables' end."
    ),
]


@app.callback()
def start(
    context: typer.Context,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say more on stderr.")] = False,
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    """Set up logging; print help where no command is given."""
    logging.basicConfig(
        level=logging.INFO if verbose else logging.WARNING, format="rigtwin: %(levelname)s: %(message)s"
    )
    if version:
        from importlib.metadata import version as version_of

        print(version_of("rigtwin"))
    elif context.invoked_subcommand is None:
        print(context.get_help())
    else:
        sweep_leftovers()


@app.command(short_help="Everything from nothing to the result page.")
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the result page.")] = Path("runs/demo"),
    fmus: Annotated[Path, typer.Option(help="Folder of the FMUs.")] = Path("dist"),
) -> None:
    """Everything from nothing: both FMUs, virtual tests, the paper's own numbers, one result page."""
    from rigtwin.commands.demo import run_demo

    run_demo(out, fmus)


@app.command(short_help="Build the FMUs of a rig.")
def build(
    rig: Annotated[str, typer.Argument(help="A rig TOML, or the name of a shipped rig.")] = RIG,
    out: Annotated[Path, typer.Option(help="Folder for the FMUs.")] = Path("dist"),
    train: Annotated[
        bool, typer.Option(help="Train an estimator for a rig of your own (a quarter of an hour or so).")
    ] = False,
    native: Annotated[
        bool, typer.Option(help="Build them once more without Python inside: OUT/fmi2, OUT/fmi3.")
    ] = False,
    array_output: Annotated[
        bool, typer.Option(help="FMI 3.0: all accelerations as one array, too; not every importer reads arrays.")
    ] = False,
    k_b_input: Annotated[
        bool, typer.Option("--k-b-input", help="k_b is an input of the rotor, for other FMUs, and no parameter.")
    ] = False,
    target: Annotated[
        list[str] | None,
        typer.Option(metavar="PLATFORM", help="With --native: here, x86_64-linux, ...; repeat. Default all."),
    ] = None,
    tracker: Annotated[bool, typer.Option(help="StiffnessTracker.fmu, too: k_b that changes in time.")] = False,
    monitor: Annotated[
        bool, typer.Option(help="GapMonitor.fmu, too: says that the rotor has changed, and how.")
    ] = False,
    tracker_node: Annotated[
        list[int] | None, typer.Option(min=1, max=MOST_NODES, help="Node that tracker and monitor read; repeat.")
    ] = None,
    tracker_network: Annotated[
        Path | None, typer.Option(help="Network of the tracker, an ONNX file of rigtwin train --tracker.")
    ] = None,
) -> None:
    """Build RotorRig.fmu of a rig, and StiffnessEstimator.fmu for the rig its network knows."""
    from rigtwin.commands.build import BuildRequest, build_fmus

    read, targets = tuple(tracker_node or ()), tuple(target or ())
    asked_for = tracker or tracker_network is not None or (bool(read) and not monitor)
    wanted = {"StiffnessTracker": asked_for, "GapMonitor": monitor}
    listeners = tuple(name for name, asked in wanted.items() if asked)
    build_fmus(
        BuildRequest(rig, out, train, native, array_output, k_b_input, targets, listeners, read, tracker_network)
    )


@app.command(short_help="Measure a run on the virtual rig, fit its modes.")
def sweep(
    source: Annotated[
        str, typer.Argument(metavar="FMU_or_RIG", help="RotorRig.fmu, a rig TOML or a shipped rig.")
    ] = RIG,
    support: Annotated[Support, typer.Option(help="How the rotor is held.")] = Support.bearing,
    effects: Annotated[
        list[str] | None, typer.Option("--effect", metavar="ID", help="Effect of rotor or measurement chain; repeat.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="FMU parameter, or ID.PARAM of an effect; repeat."),
    ] = None,
    f_min: Annotated[float, typer.Option(help="Lowest frequency [Hz].")] = 20.0,
    f_max: Annotated[float, typer.Option(help="Highest frequency [Hz].")] = 400.0,
    lines: Annotated[
        int, typer.Option(max=MOST_LINES, help="Evenly spaced lines; more are added at resonances.")
    ] = 201,
    force: Annotated[float, typer.Option(help="Force amplitude [N], peak.")] = 1.0,
    levels: Annotated[
        str | None, typer.Option(metavar="F1,F2,...", help="Force amplitudes in place of --force, a run each [N].")
    ] = None,
    settle_time: Annotated[float, typer.Option(help="Pause between two looks whether a line has settled [s].")] = 30.0,
    direction: Annotated[Direction, typer.Option(help="Order of the lines.")] = Direction.up,
    excitation_node: Annotated[
        int | None, typer.Option(min=1, max=MOST_NODES, help="Node of the force; default the rig's.")
    ] = None,
    plane: Annotated[Plane, typer.Option(help="Plane of the force.")] = Plane.y,
    across: Annotated[bool, typer.Option("--across", help="Accelerometers across the force, too.")] = False,
    quantity: Annotated[
        Literal["accelerance", "acceleration"], typer.Option(help="Per newton, or at the nominal force as it is.")
    ] = "accelerance",
    spin_rpm: Annotated[float, typer.Option(help="Spin [rev/min].")] = 0.0,
    noise: Annotated[float, typer.Option(min=0.0, max=100.0, help="Sensor noise, relative to each line.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Run file: .csv, .uff, .unv, .h5 or .mat.")] = None,
    executor: ExecutorOption = None,
    trust: TRUST = False,
    as_json: JSON = False,
) -> None:
    """Measure stepped-sine runs on the virtual rig, with effects, and fit their modes."""
    from rigtwin.api.sweeps import SweepRequest
    from rigtwin.commands.settings import parse_effects
    from rigtwin.commands.sweep import Output, levels_of, parse_settings, plan_of, run_sweep

    chosen, parameters = parse_effects(tuple(effects or ()), tuple(settings or ()))
    request = SweepRequest(
        source=source,
        support=support.value,
        effects=chosen,
        parameters=parse_settings(parameters),
        plan=plan_of(f_min, f_max, lines, force, direction.value, settle_time),
        levels=levels_of(levels),
        noise=noise,
        seed=seed,
        excitation_node=excitation_node,
        plane=plane.value,
        across=across,
        quantity=quantity,
        spin_rpm=spin_rpm,
        executor=executor,
        trust=trust,
    )
    run_sweep(request, Output(out, as_json))


@app.command(short_help="Measure rigs through the FMU, train the estimator.")
def train(
    rig: Annotated[str, typer.Option(help="A rig TOML, or the name of a shipped rig.")] = RIG,
    rigs: Annotated[int, typer.Option(max=MOST_RIGS, help="Number of training rigs.")] = 1024,
    calibration_rigs: Annotated[int, typer.Option(max=MOST_RIGS, help="Number of calibration rigs.")] = 512,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the training rigs.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for data, network and FMUs.")] = Path("runs/train"),
    from_data: Annotated[bool, typer.Option("--from-data", help="Measure nothing: train on the shipped data.")] = False,
    tracker: Annotated[
        bool, typer.Option("--tracker", help="Train the tracker's network, on as many streams of a rig that runs.")
    ] = False,
    tracker_node: Annotated[
        list[int] | None, typer.Option(min=1, max=MOST_NODES, help="With --tracker: node that it reads; repeat.")
    ] = None,
    executor: ExecutorOption = None,
) -> None:
    """Measure rigs through the FMU and train the estimator; started again, it goes on where it stopped.

    With --tracker, train the network that is method 1 of the tracker.
    """
    from rigtwin.commands.training import TrainingPlan, print_trained, train, train_from_data

    plan = TrainingPlan(rig=rig, rigs=rigs, seed=seed, calibration_rigs=calibration_rigs, out=out, executor=executor)
    if from_data and (rig, rigs, seed, calibration_rigs, executor) != (RIG, 1024, 1, 512, None):
        raise UserError(
            "--from-data trains on the shipped data alone; leave out --rig, --rigs, --calibration-rigs, --seed, "
            "--executor"
        )
    if tracker_node and not tracker:
        raise UserError(
            "--tracker-node: only the tracker's network reads other nodes than the driven one; add --tracker"
        )
    if tracker:
        from rigtwin.commands.tracker_training import print_trained_tracker, train_tracker

        if from_data:
            raise UserError("--from-data: no streams are shipped for a tracker; leave it out")
        print_trained_tracker(train_tracker(plan, tuple(tracker_node or ())))
        return
    print_trained(train_from_data(out) if from_data else train(plan))


@app.command(short_help="Bearing stiffness from measured runs or numbers.")
def estimate(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="[RIGID_FILE BEARING_FILE | CAMPAIGN_DIR]", help="What was measured.")
    ] = None,
    delta_f1: Annotated[float | None, typer.Option(help="Shift of mode 1, rigid minus bearing [Hz].")] = None,
    delta_f2: Annotated[float | None, typer.Option(help="Shift of mode 2 [Hz].")] = None,
    amplitude_ratio: Annotated[float | None, typer.Option(help="A1/A0 of mode 1, bearing over rigid [-].")] = None,
    delta_f1_std: Annotated[float | None, typer.Option(help="Standard error [Hz].")] = None,
    delta_f2_std: Annotated[float | None, typer.Option(help="Standard error [Hz].")] = None,
    amplitude_ratio_std: Annotated[float | None, typer.Option(help="Standard error [-].")] = None,
    excitation_node: Annotated[
        int | None, typer.Option(min=1, max=MOST_NODES, help="Node of the force, where files do not say.")
    ] = None,
    quantity: Annotated[Quantity | None, typer.Option(help="What the files hold, where they do not say.")] = None,
    estimator: Annotated[Path | None, typer.Option(help="FMU or ONNX file; default the shipped network.")] = None,
    rig: Annotated[
        str | None, typer.Option(help="The rig of the files, a TOML or a shipped one; default the estimator's.")
    ] = None,
    method: Annotated[
        Method | None,
        typer.Option(help="By shifts (network, model) or all lines; default all lines of a campaign, else shifts."),
    ] = None,
    trust: TRUST = False,
    as_json: JSON = False,
) -> None:
    """Bearing stiffness from two measured runs, a campaign folder, or numbers."""
    from rigtwin.api.estimates import estimate as answer
    from rigtwin.commands.estimate import print_answers

    numbers = {
        "delta_f1": delta_f1,
        "delta_f2": delta_f2,
        "amplitude_ratio": amplitude_ratio,
        "delta_f1_std": delta_f1_std,
        "delta_f2_std": delta_f2_std,
        "amplitude_ratio_std": amplitude_ratio_std,
    }
    answers = answer(
        *(paths or ()),
        rig=rig,
        estimator=estimator,
        excitation_node=excitation_node,
        quantity=quantity.value if quantity else None,
        method=method.value if method else None,
        trust=trust,
        **numbers,
    )
    print_answers(answers, as_json=as_json)


@app.command(short_help="Gate for CI: compliance, replay, known stiffness.")
def check(
    fmu: Annotated[Path, typer.Argument(help="RotorRig.fmu, StiffnessEstimator.fmu, or another for co-simulation.")],
    expect_k_b: Annotated[float | None, typer.Option(help="The rig must give back this stiffness [N/m].")] = None,
    tolerance: Annotated[float, typer.Option(help="Largest relative error of it.")] = 0.05,
    estimator: Annotated[Path | None, typer.Option(help="Estimator FMU; default the one found.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write a JUnit report.")] = None,
    time_limit: Annotated[float, typer.Option(help="Seconds that a gate may take; then it fails.")] = 600.0,
    as_json: JSON = False,
) -> None:
    """Gate for CI: does the FMU comply, replay, refuse, and give back a known stiffness? Exit 3 when not."""
    from rigtwin.commands.check import run_check

    passed = run_check(
        fmu,
        expect_k_b=expect_k_b,
        tolerance=tolerance,
        estimator=estimator,
        junit=junit,
        time_limit=time_limit,
        as_json=as_json,
    )
    if not passed:
        raise typer.Exit(GATE_FAILED)


class ExcludingCommand(TyperCommand):
    """Takes ``--exclude A B`` as ``--exclude A --exclude B``: options take one value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The arguments with the option before every word that follows one, unless it is an option or a folder."""
        told: list[str] = []
        for word in args:
            follows = told[-2:-1] == ["--exclude"] and not word.startswith("-") and not Path(word).exists()
            told += ["--exclude", word] if follows else [word]
        return super().parse_args(ctx, told)


@app.command(cls=ExcludingCommand, short_help="Where the gap to the model lies, and what causes it.")
def diagnose(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of the campaign.")],
    out: Annotated[Path, typer.Option(help="Folder for diagnosis.json and report.html.")],
    exclude: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="Effect that is no candidate; repeat, A,B or A B.")
    ] = None,
    no_fmu: Annotated[
        bool, typer.Option("--no-fmu", help="Build no FMU: the shrink is the fitting model's own.")
    ] = False,
    workers: Annotated[
        int | None, typer.Option(min=1, max=MOST_WORKERS, help="Processes for the fits; default one for each core.")
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(min=0, help="Seconds of work after which no further cause is tried; default 300.")
    ] = None,
    as_json: JSON = False,
) -> None:
    """Where the gap between a campaign and the nominal model lies, which effect causes it, how far it shrinks."""
    from rigtwin.commands.diagnose import DiagnosisRequest, run_diagnose

    excluded = tuple(name.strip() for names in exclude or () for name in names.rstrip(", ").split(","))
    request = DiagnosisRequest(campaign, out, excluded, not no_fmu, as_json, workers, time_limit)
    run_diagnose(request)


@app.command(short_help="A diagnosis applied to runs it never saw.")
def predict(
    diagnosis: Annotated[Path, typer.Argument(metavar="DIAGNOSIS_JSON", help="What rigtwin diagnose wrote.")],
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of the campaign to predict.")],
    out: Annotated[Path, typer.Option(help="Folder for nominal/, corrected/ and prediction.html.")],
    as_json: JSON = False,
) -> None:
    """Each run of a campaign as the nominal and as the corrected model compute it, and the gap to what was measured."""
    from rigtwin.commands.diagnose import run_predict

    run_predict(diagnosis, campaign, out, as_json=as_json)


@app.command(short_help="What has changed between two campaigns.")
def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="Folder of the earlier campaign.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Folder of the later one, of the same rig.")],
    out: Annotated[Path | None, typer.Option(help="Page with the tables and the responses.")] = None,
    as_json: JSON = False,
) -> None:
    """Resonances, dampings and amplitudes of two campaigns: by how much they differ, and which do so significantly."""
    from rigtwin.commands.compare import run_compare

    run_compare(a, b, out, as_json=as_json)


@app.command(short_help="The diagnosis on campaigns whose cause is sealed.")
def blind(
    sets: Annotated[list[str] | None, typer.Argument(metavar="[SET...]", help="W1 to W9; default all.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for campaigns, answers and blind.md.")] = Path("runs/blind"),
    split: Annotated[str, typer.Option(help="tuning or report.")] = "tuning",
    count: Annotated[int, typer.Option(min=1, max=MOST_CAMPAIGNS, help="Campaigns of each set.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draws.")] = 1,
    workers: Annotated[int, typer.Option(min=1, max=MOST_WORKERS, help="Processes.")] = 2,
    executor: ExecutorOption = None,
    page: Annotated[
        Path | None, typer.Option(help="The page, its results beside it as JSON; default blind.md in the folder.")
    ] = None,
    render_only: Annotated[
        bool, typer.Option("--render-only", help="Write the page of its results, and no more.")
    ] = False,
) -> None:
    """Make sealed campaigns with a generator of its own, diagnose them, score the answers. What exists is kept."""
    from rigtwin.blind import SETS
    from rigtwin.commands.blind import BlindRequest, run_blind

    if split not in ("tuning", "report"):
        raise UserError(f"--split {split}: give tuning or report")
    run_blind(
        BlindRequest(
            sets=tuple(sets or SETS),
            split=split,
            count=count,
            out=out,
            seed=seed,
            workers=workers,
            executor=executor,
            page=page,
            render_only=render_only,
        )
    )


@app.command(short_help="What reality may have and the nominal rotor lacks.")
def effects(
    effect_id: Annotated[str | None, typer.Argument(metavar="[ID]", help="One effect; default: a list of all.")] = None,
    as_json: JSON = False,
) -> None:
    """The effect library: what each effect adds, with its parameters, prior ranges and places."""
    from rigtwin.commands.effects import print_effect, print_effects

    if effect_id is None:
        print_effects(as_json=as_json)
    else:
        print_effect(effect_id, as_json=as_json)


@app.command(short_help="Natural frequencies, damping, whirl and mode shapes.")
def modes(
    rig: RIG_ARGUMENT = RIG,
    spin_rpm: Annotated[float, typer.Option(help="Spin [rev/min].")] = 0.0,
    number: Annotated[int, typer.Option("--modes", min=1, help="How many modes.")] = 6,
    k_b: K_B = None,
    rigid: RIGID = False,
    bearing_damping: BEARING_DAMPING = None,
    shaft_damping_ratio: SHAFT_DAMPING = None,
    effects: EFFECTS_ON = None,
    settings: EFFECT_SETTINGS = None,
    out: PICTURE = None,
    as_json: JSON = False,
) -> None:
    """Natural frequencies, damping, whirl direction and shapes of a rotor's modes, at rest or at one spin speed."""
    from rigtwin.commands.asked_rotor import RotorRequest
    from rigtwin.commands.modes import run_modes

    chosen = tuple(effects or ()), tuple(settings or ())
    request = RotorRequest(rig, *chosen, k_b, rigid, bearing_damping, shaft_damping_ratio, out, as_json)
    run_modes(request, spin_rpm, number)


@app.command(short_help="Whirl frequencies over spin speed, and critical speeds.")
def campbell(
    rig: RIG_ARGUMENT = RIG,
    rpm_min: RPM_MIN = None,
    rpm_max: RPM_MAX = None,
    speeds: Annotated[int, typer.Option(min=3, max=10_000, help="Speeds at which modes are computed.")] = 61,
    number: Annotated[
        int, typer.Option("--modes", min=1, help="How many modes, forward and backward whirl apart.")
    ] = 6,
    multiple: Annotated[float, typer.Option(help="Order of the line that is crossed: 1 for unbalance.")] = 1.0,
    k_b: K_B = None,
    rigid: RIGID = False,
    bearing_damping: BEARING_DAMPING = None,
    shaft_damping_ratio: SHAFT_DAMPING = None,
    effects: EFFECTS_ON = None,
    settings: EFFECT_SETTINGS = None,
    out: PICTURE = None,
    as_json: JSON = False,
) -> None:
    """Campbell diagram: frequencies of forward and backward whirl over spin speed, and where they meet its 1x line."""
    from rigtwin.commands.asked_rotor import RotorRequest
    from rigtwin.commands.campbell import SpeedRange, run_campbell

    chosen = tuple(effects or ()), tuple(settings or ())
    request = RotorRequest(rig, *chosen, k_b, rigid, bearing_damping, shaft_damping_ratio, out, as_json)
    run_campbell(request, SpeedRange(rpm_min, rpm_max, speeds), number, multiple)


@app.command(short_help="Undamped critical speeds over bearing stiffness.")
def critical_speeds(
    rig: Annotated[
        str | None, typer.Argument(metavar="RIG", help=f"A rig; default that of --campaign, or {RIG}.")
    ] = None,
    k_b_min: Annotated[float | None, typer.Option(help="Lowest stiffness [N/m]; default the rig file's.")] = None,
    k_b_max: Annotated[float | None, typer.Option(help="Highest stiffness [N/m]; default the rig file's.")] = None,
    stiffnesses: Annotated[int, typer.Option(min=2, max=10_000, help="Stiffnesses of the map.")] = 81,
    number: Annotated[int, typer.Option("--modes", min=1, help="How many critical speeds.")] = 6,
    campaign: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Campaign whose resonances are drawn on the map.")
    ] = None,
    effects: EFFECTS_ON = None,
    settings: EFFECT_SETTINGS = None,
    out: PICTURE = None,
    as_json: JSON = False,
) -> None:
    """Map of the undamped critical speeds over bearing stiffness, and the stiffness that measured resonances tell."""
    from rigtwin.commands.asked_rotor import RotorRequest
    from rigtwin.commands.critical_speeds import StiffnessRange, run_critical_speeds

    request = RotorRequest(rig or "", tuple(effects or ()), tuple(settings or ()), out=out, as_json=as_json)
    run_critical_speeds(request, StiffnessRange(k_b_min, k_b_max, stiffnesses), number, campaign)


@app.command(short_help="Steady response to unbalance over spin speed.")
def unbalance(
    rig: RIG_ARGUMENT = RIG,
    node: Annotated[
        list[int] | None, typer.Option(help="Node of an unbalance; repeat. Default the heaviest disk's.")
    ] = None,
    moment: Annotated[
        list[float] | None, typer.Option(help="Unbalance [kg m], for all nodes or once for each; default 1e-5.")
    ] = None,
    phase_deg: Annotated[
        list[float] | None, typer.Option(help="Its angle from y towards z [degrees], as --moment; default 0.")
    ] = None,
    read: Annotated[list[int] | None, typer.Option(help="Node whose motion is shown; repeat. Default all.")] = None,
    rpm_min: RPM_MIN = None,
    rpm_max: RPM_MAX = None,
    speeds: Annotated[
        int, typer.Option(min=2, max=100_000, help="Evenly spaced speeds; more are added at critical speeds.")
    ] = 301,
    k_b: K_B = None,
    rigid: RIGID = False,
    bearing_damping: BEARING_DAMPING = None,
    shaft_damping_ratio: SHAFT_DAMPING = None,
    effects: EFFECTS_ON = None,
    settings: EFFECT_SETTINGS = None,
    out: PICTURE = None,
    as_json: JSON = False,
) -> None:
    """Amplitude and phase of the steady response to unbalance, over spin speed, at the nodes."""
    from rigtwin.commands.asked_rotor import RotorRequest
    from rigtwin.commands.campbell import SpeedRange
    from rigtwin.commands.unbalance import Weights, run_unbalance

    chosen = tuple(effects or ()), tuple(settings or ())
    request = RotorRequest(rig, *chosen, k_b, rigid, bearing_damping, shaft_damping_ratio, out, as_json)
    weights = Weights(tuple(node or ()), tuple(moment or (1e-5,)), tuple(phase_deg or (0.0,)))
    run_unbalance(request, weights, SpeedRange(rpm_min, rpm_max, speeds), tuple(read or ()))


@app.command(short_help="A bearing softens: tracker and speed supervisor at work.")
def system(
    rig: RIG_ARGUMENT = RIG,
    out: Annotated[Path, typer.Option(help="Folder for the FMUs, the SSP and the page.")] = Path("runs/system"),
    seconds: Annotated[
        float | None, typer.Option(min=0.1, max=1e4, help="Time that is simulated [s]; default what suits the rig.")
    ] = None,
    as_json: JSON = False,
) -> None:
    """Run a machine whose bearing softens, as one system of four FMUs, with and without its speed supervisor.

    Rotor, bearing, stiffness tracker and supervisor become one SSP for any host. One page shows what fmpy makes of it.
    """
    from rigtwin.commands.system import SystemRequest, run_system

    run_system(SystemRequest(rig, out, seconds, as_json))


@app.command(name="inspect", short_help="What a data file holds, and what is odd about it.")
def inspect_command(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="A run: .csv, .uff, .unv, .h5 or .mat.")],
    settings: Annotated[list[str] | None, RUN_SETTING] = None,
    rig: Annotated[
        str | None, typer.Option(help="Its rig, a TOML or a shipped one: names and units are checked.")
    ] = None,
    as_json: JSON = False,
) -> None:
    """What a data file holds, what is odd about it, and the lines to write into campaign.toml."""
    from rigtwin.commands.files import inspect_file

    inspect_file(path, settings or (), rig, as_json=as_json)


@app.command(short_help="A run in another format, unit or quantity.")
def convert(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="A run: .csv, .uff, .unv, .h5 or .mat.")],
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="The new file; its suffix says the format.")],
    settings: Annotated[list[str] | None, RUN_SETTING] = None,
    quantity: Annotated[
        Literal["receptance", "mobility", "accelerance"] | None, typer.Option(help="Of the new file; default the same.")
    ] = None,
) -> None:
    """Write a run in another format, in SI units, with all that is known of it."""
    from rigtwin.commands.files import convert_file

    convert_file(source, target, settings or (), quantity)


@app.command(name="reduce", short_help="A run from time records of an oscilloscope or logger.")
def reduce_command(
    records: Annotated[list[Path], typer.Argument(help="Records, or folders of them: " + RECORDS)],
    out: Annotated[Path, typer.Option(help="The run file: .csv, .uff, .unv, .h5 or .mat.")],
    plan: Annotated[Path | None, typer.Option(help="TOML that says which channel is what; see docs/reduce.md.")] = None,
    channels: Annotated[
        list[str] | None,
        typer.Option(
            "--channel", metavar="NAME=COLUMN,SENSITIVITY", help='As "force=CH1, 22.4 mV/N" or "node2=CH2, g"; repeat.'
        ),
    ] = None,
    method: Annotated[
        Literal["sine", "hammer", "random"] | None, typer.Option(help="How the rotor was excited; default sine.")
    ] = None,
    estimator: Annotated[
        Literal["h1", "h2"] | None, typer.Option(help="Of hammer and random records; default h1.")
    ] = None,
    sample_rate: Annotated[float | None, typer.Option(help="Samples a second; wins over the files [Hz].")] = None,
    settings: Annotated[list[str] | None, RUN_SETTING] = None,
    as_json: JSON = False,
) -> None:
    """Time records become frequency lines with standard errors, and the lines to write into campaign.toml."""
    from rigtwin.commands.reduce import ReduceRequest, run_reduce

    told = {"method": method, "estimator": estimator, "sample_rate_Hz": sample_rate}
    run_reduce(
        ReduceRequest(
            records=tuple(records),
            out=out,
            plan=plan,
            channels=tuple(channels or ()),
            told={key: value for key, value in told.items() if value is not None},
            settings=tuple(settings or ()),
            as_json=as_json,
        )
    )


@app.command(short_help="One HTML page of measured runs.")
def report(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="[DIR | FILES]", help="A campaign folder, or runs.")
    ] = None,
    rigid: Annotated[list[Path] | None, typer.Option(help="A run on rigid supports; repeat.")] = None,
    bearing: Annotated[list[Path] | None, typer.Option(help="A run on bearings; repeat.")] = None,
    out: Annotated[Path, typer.Option(help="The page.")] = Path("page.html"),
    rig: Annotated[str | None, typer.Option(help="The rig of the files, a TOML or a shipped one.")] = None,
    estimator: Annotated[Path | None, typer.Option(help="FMU or ONNX file; default the shipped network.")] = None,
    trust: TRUST = False,
) -> None:
    """One HTML page of measured runs: responses, fitted modes, and k_b where both supports are there."""
    from rigtwin.commands.report import run_report

    run_report(
        paths or (), rigid=rigid or (), bearing=bearing or (), out=out, rig=rig, estimator=estimator, trust=trust
    )


@app.command(name="app", short_help="The diagnosis as a page in the browser.")
def app_command(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of this machine; 0 for any that is free.")] = 8050,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Open no browser, print the address alone.")] = False,
) -> None:
    """Drop a campaign into the browser, watch its diagnosis, read the report. Nobody else can reach it."""
    from rigtwin.commands.app import run_app

    run_app(port, browser=not no_browser)


def main() -> None:
    """The ``rigtwin`` command."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    install_interrupt()
    end_at_the_second()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without "±" must not stop a command
    app(prog_name="rigtwin")
