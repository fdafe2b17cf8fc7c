"""The page of the app, and what happens on it."""

from __future__ import annotations

import base64
import binascii
import shutil
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dash import Dash, Input, Output, State, ctx, dcc, html, no_update
from flask import Response, abort, request, send_from_directory
from markupsafe import Markup

from rigtwin.app.job import WORKER, Job
from rigtwin.app.job import State as Progress
from rigtwin.app.uploads import MEGABYTE, MOST_SENT, SUFFIXES, unpack
from rigtwin.errors import UserError
from rigtwin.pages.page import render
from rigtwin.pages.palette import style_variables
from rigtwin.scratch import Scratch

REPORT, DOCUMENT = "report.html", "diagnosis.json"

# Milliseconds between two looks at how far the diagnosis has come.
_LOOK_EVERY = 500

# Stages that are listed; those before are over.
_SHOWN = 8

_WHAT_TO_GIVE = (
    "Give the folder of a campaign as a .zip file, or its files: campaign.toml, the data files and, where the rotor is "
    f"your own, its rig file. All of it stays on this machine. At most {MOST_SENT // MEGABYTE} MB."
)


class Bench:
    """The one diagnosis that an app has at a time, and its folders."""

    def __init__(self, worker: Sequence[str] = WORKER):
        self._scratch = Scratch("app_")
        self._worker = worker
        self._lock = threading.Lock()
        self._count = 0
        self.job: Job | None = None

    def start(self, sent: Sequence[tuple[str, bytes]]) -> None:
        """Diagnose what was sent; a diagnosis that still runs is ended. Raises UserError."""
        with self._lock:
            before = self._scratch.path / str(self._count)
            folder = self._scratch.path / str(self._count + 1)
            uploaded, out, temporary = (folder / name for name in ("uploaded", "out", "temporary"))
            for each in (uploaded, out, temporary):
                each.mkdir(parents=True)
            try:
                campaign = unpack(sent, uploaded)
            except UserError:
                shutil.rmtree(folder, ignore_errors=True)
                raise
            self.cancel()
            shutil.rmtree(before, ignore_errors=True)
            self._count += 1
            name = campaign.name if campaign != uploaded else ", ".join(name for name, _ in sent)
            self.job = Job(name, campaign, out, temporary, self._worker)

    def cancel(self) -> None:
        """End the diagnosis that runs."""
        if self.job:
            self.job.cancel()

    def close(self) -> None:
        """End it, and remove all files."""
        self.cancel()
        self._scratch.close()


def make_app(bench: Bench) -> Dash:
    """The page and its server, which serves the results, too."""
    app = Dash(
        "rigtwin",
        title="rigtwin: diagnose a campaign",
        update_title="",
        assets_folder="none",  # there is no such folder, and none else is served
        include_assets_files=False,
    )
    app.index_string = render("app.html", colours=Markup(style_variables()))
    app.layout = _layout()
    app.server.config["MAX_CONTENT_LENGTH"] = 4 * MOST_SENT // 3 + MEGABYTE  # files are sent in base64
    _serve_results(app, bench)
    _connect(app, bench)
    return app


def _layout() -> html.Main:
    return html.Main(
        [
            html.H1("Diagnose a campaign"),
            html.P(_WHAT_TO_GIVE),
            dcc.Upload(
                [html.P("Drop the files here, or"), html.Button("Choose files", type="button", id="choose")],
                id="upload",
                multiple=True,
                className="drop",
                max_size=MOST_SENT,
                accept=",".join((".zip", *SUFFIXES)),
                style={},
            ),
            html.Div(id="progress", role="status"),
            html.Button("Cancel", id="cancel", disabled=True),
            html.Div(id="result"),
            dcc.Interval(id="clock", interval=_LOOK_EVERY, disabled=True),
        ]
    )


def _connect(app: Dash, bench: Bench) -> None:
    @app.callback(
        Output("progress", "children"),
        Output("result", "children"),
        Output("cancel", "disabled"),
        Output("clock", "disabled"),
        Output("upload", "contents"),
        Input("upload", "contents"),
        Input("cancel", "n_clicks"),
        Input("clock", "n_intervals"),
        State("upload", "filename"),
        prevent_initial_call=True,
    )
    def look(contents: list[str] | None, _clicks: int | None, _looks: int | None, names: list[str] | None) -> Any:
        if ctx.triggered_id == "upload":
            if not contents:
                return (no_update,) * 5
            try:
                bench.start(list(zip(names or [], map(_decoded, contents), strict=True)))
            except UserError as error:
                return _error(str(error)), [], True, True, None
        elif ctx.triggered_id == "cancel":
            bench.cancel()
        if bench.job is None:
            return [], [], True, True, no_update
        progress = bench.job.state
        return _progress(progress), _result(progress), progress.ended, progress.ended, None


def _decoded(content: str) -> bytes:
    """Of 'data:text/csv;base64,...'. Raises UserError."""
    try:
        return base64.b64decode(content.partition(",")[2], validate=True)
    except binascii.Error as error:
        raise UserError("a file was cut off on its way; send it again") from error


def _error(words: str) -> html.P:
    return html.P(words, role="alert")


def _progress(progress: Progress) -> list[Any]:
    """What has been done, what is being done, and how far it is."""
    if progress.error:
        return [html.H2(progress.name), _error(progress.error)]
    if progress.cancelled:
        return [html.H2(progress.name), html.P("Cancelled.")]
    steps = list(progress.steps[-_SHOWN:])
    listed = html.Ol(
        [html.Li(f"{step.words}, {step.done} of {step.total}") for step in steps],
        start=str(len(progress.steps) - len(steps) + 1),
    )
    if progress.sentence:
        return [html.H2(progress.name), html.Details([html.Summary("What was done"), listed])]
    now = steps[-1] if steps else None
    bar = html.Progress(value=str(now.done), max=str(max(now.total, 1))) if now else html.Progress()
    return [html.H2(progress.name), html.P("The diagnosis goes on; it takes from seconds to minutes."), bar, listed]


def _result(progress: Progress) -> list[Any]:
    if not progress.sentence:
        return []
    return [
        html.H2("Result"),
        html.P(progress.sentence, className="result", id="sentence"),
        html.Div(
            [
                html.A("Open the report", href=f"/result/{REPORT}", target="_blank", className="button"),
                html.A("Download the report", href=f"/result/{REPORT}?download", className="button"),
                html.A("Download diagnosis.json", href=f"/result/{DOCUMENT}?download", className="button"),
            ],
            className="links",
        ),
        html.Iframe(src=f"/result/{REPORT}", title="The report"),
    ]


def _serve_results(app: Dash, bench: Bench) -> None:
    @app.server.get("/result/<name>")
    def result(name: str) -> Response:
        job = bench.job
        if job is None or not job.state.sentence or name not in (REPORT, DOCUMENT):
            abort(404)
        return send_from_directory(Path(job.out), name, as_attachment="download" in request.args, max_age=0)
