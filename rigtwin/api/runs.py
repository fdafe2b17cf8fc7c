"""Measured data: runs and campaigns from files and into files, and the modes of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.api.rigs import as_rig
from rigtwin.errors import for_users
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model import html
from rigtwin.sim import campaign_folder
from rigtwin.sim.campaign import Campaign, Run
from rigtwin.sim.formats import read_run, write_run
from rigtwin.sim.modal_fit import Mode, driving_point, try_modes
from rigtwin.wording import with_error


@for_users
def load_run(path: str | Path, rig: Rig | str | Path | None = None, **settings: Any) -> Run:
    """One measured run from a .csv, .uff, .unv, .h5 or .mat file.

    Parameters
    ----------
    rig : that was measured: its file says where the exciter is, if neither the run's file nor the settings do
    settings : how the run was measured, where the file does not say it: the keys of a ``[[run]]`` in campaign.toml,
        such as ``support="rigid"``, ``excitation_node=2``, ``force_amplitude_N=1.0`` or ``unit="g/N"``. A CSV file
        does not say its support.

    Returns
    -------
    ``frequency_hz`` (n_freq,), ``H`` (n_freq, n_channels) in SI units and its standard errors ``std``, where known

    Raises
    ------
    UserError : the file or a setting cannot be used; the message names the file and the line, column or key

    >>> import rigtwin
    >>> rigtwin.load_run("missing.csv", support="rigid")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: missing.csv: no such file; check its name and folder
    """
    return read_run(path, as_rig(rig).excitation_node if rig else Run.excitation_node, **settings)


@for_users
def save_run(run: Run, path: str | Path) -> Path:
    """Write a run into a .csv, .uff, .unv, .h5 or .mat file, and return its path.

    Raises
    ------
    UserError : the suffix is of no format that is known, or the file cannot be written

    >>> import rigtwin
    >>> rigtwin.save_run(rigtwin.model_response("nit-rourkela", [50.0, 60.0]), "run.xlsx")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: run.xlsx: unknown kind of file; a run is one of .csv, .uff, .unv, .h5, .mat
    """
    write_run(run, Path(path))
    return Path(path)


@for_users
def load_campaign(folder: str | Path) -> Campaign:
    """Everything that was measured on one rig: a folder with ``campaign.toml`` and its data files.

    Raises
    ------
    UserError : the folder, campaign.toml or a data file cannot be used; the message names the file and the key or line

    >>> import rigtwin
    >>> rigtwin.load_campaign("no-such-folder")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: no-such-folder: no such folder; give the folder that holds campaign.toml
    """
    return campaign_folder.load_campaign(folder)


@for_users
def save_campaign(campaign: Campaign, folder: str | Path, file_format: str = "csv") -> Path:
    """Write a campaign folder, and return its path; it is new as a whole or not at all.

    Parameters
    ----------
    file_format : of the runs: "csv", "uff", "unv", "h5" or "mat"

    Raises
    ------
    UserError : the format is unknown, or the folder cannot be written

    >>> import rigtwin, tempfile
    >>> run = rigtwin.model_response("nit-rourkela", [50.0, 60.0], support="rigid")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = rigtwin.save_campaign(rigtwin.Campaign("a test", "nit-rourkela", (run,)), folder)
    ...     rigtwin.load_campaign(folder).runs[0].support
    'rigid'
    """
    campaign_folder.save_campaign(campaign, folder, file_format)
    return Path(folder)


# The response is the mode's own, at its resonance and at the driving point, in the unit of the run.
MODE_HEADER = ("mode", "frequency, Hz", "damping, %", "driving-point response", "misfit")


@dataclass(frozen=True)
class Modes:
    """The modes that were fitted to a run, lowest first, with standard errors; a sequence of them."""

    run: Run
    modes: tuple[Mode, ...]
    left_out: tuple[str, ...]  # a sentence on each resonance, or line, that was left out

    def __len__(self) -> int:
        return len(self.modes)

    def __getitem__(self, place: int) -> Mode:
        return self.modes[place]

    def __iter__(self) -> Iterator[Mode]:
        return iter(self.modes)

    def _repr_html_(self) -> str:
        rows = [(place, *mode_row(self.run, mode)) for place, mode in enumerate(self.modes, start=1)]
        return html.table(MODE_HEADER, rows) + "".join(map(html.paragraph, self.left_out))


@for_users
def fit_modes(run: Run, n_modes: int | None = None) -> Modes:
    """Frequencies, dampings and responses of the resonances of a run, with standard errors.

    Each resonance is fitted alone, weighted by the errors of its lines (``rigtwin.sim.modal_fit``).

    Parameters
    ----------
    run : with phases
    n_modes : only so many, the lowest; default all. One that cannot be fitted is left out, and said in ``left_out``

    Raises
    ------
    UserError : there are fewer resonances than asked for, none at all, or too few lines round one

    >>> import numpy as np, rigtwin
    >>> run = rigtwin.model_response("nit-rourkela", np.arange(94.0, 99.0, 0.02), k_b=1e7)
    >>> modes = rigtwin.fit_modes(run)
    >>> len(modes), round(modes[0].frequency_hz, 2), round(modes[0].damping_ratio, 5)
    (1, 96.53, 0.00092)
    """
    modes, left_out = try_modes(run, n_modes)
    return Modes(run, modes, left_out)


def mode_row(run: Run, mode: Mode) -> tuple[str, str, str, str]:
    """A mode for a reader: frequency, damping, driving-point response, misfit."""
    try:
        response = with_error(*driving_point(run, mode, run.excitation_node, run.excitation_plane))
    except ValueError:  # no accelerometer at the driving point
        response = ""
    known = run.std is not None and np.median(run.std) > 1e-6 * np.median(np.abs(run.H).max(axis=1))
    return (
        with_error(mode.frequency_hz, mode.frequency_std_hz),
        with_error(100 * mode.damping_ratio, 100 * mode.damping_ratio_std),
        response,
        f"{mode.misfit:.2f}" if known else "",
    )
