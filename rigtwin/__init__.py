"""A rotor test rig and its digital twin.

The names in ``__all__`` are for scripts and notebooks; each is imported when it is first used.

>>> import rigtwin
>>> rig = rigtwin.load_rig("nit-rourkela")
>>> modes = rigtwin.model_modes(rig, support="rigid", n_modes=2)
>>> modes.frequency_hz.round(1)
array([100.6, 324. ])

The rooms behind them:

===============  ==================================================================  ====================
room             what it holds                                                       start here
===============  ==================================================================  ====================
``rotor``        geometry, finite elements, effects, solvers                         ``load_rig``
``sim``          the virtual test rig, campaigns, file formats                       ``sweep``
``estimator``    the network that turns shifts and amplitude ratio into k_b          ``StiffnessEstimator``
``fmu_src``      what goes into the FMUs, and how they are built                     ``build_rotor_fmu``
``gap``          the diagnosis of the gap between a campaign and its model           ``diagnose``
``blind``        sealed campaigns of a second implementation, and their judge        ``make_all``
``api``          what commands and notebooks do with all of them                     ``sweep``
``commands``     what each ``rigtwin`` command reads and prints                      ``run_diagnose``
``pages``        the HTML pages and their figures                                    ``write_page``
``app``          the diagnosis as a page in the browser                              ``AppServer``
``cli``          the commands and their options                                      ``app``
``errors``       the one error that a user sees                                      ``UserError``
``exits``        exit codes, and what a user sees of an error                        ``CommandGroup``
``interrupt``    Ctrl-C and SIGTERM                                                  ``install``
``console``      tables, progress bars, JSON                                         ``progress``
``shared_work``  items of work that helpers share, within a time                    ``each``
``workers``      processes that end with this one                                    ``worker_pool``
``scratch``      temporary folders, and files that are replaced as a whole           ``replacing``
``parsing``      TOML and JSON                                                       ``parse_toml``
``scale_out``    processes here, or the workers of a dask cluster                    ``executor``
``wording``      numbers as they are printed                                         ``with_error``
===============  ==================================================================  ====================
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigtwin.api.checks import check_fmu as check_fmu
    from rigtwin.api.comparisons import compare as compare
    from rigtwin.api.diagnoses import diagnose as diagnose
    from rigtwin.api.diagnoses import load_diagnosis as load_diagnosis
    from rigtwin.api.estimates import estimate as estimate
    from rigtwin.api.fmus import build_fmu as build_fmu
    from rigtwin.api.predictions import predict as predict
    from rigtwin.api.reports import report as report
    from rigtwin.api.rigs import effect as effect
    from rigtwin.api.rigs import effects as effects
    from rigtwin.api.rigs import load_rig as load_rig
    from rigtwin.api.rigs import model_modes as model_modes
    from rigtwin.api.rigs import model_response as model_response
    from rigtwin.api.rigs import shipped_rigs as shipped_rigs
    from rigtwin.api.runs import fit_modes as fit_modes
    from rigtwin.api.runs import load_campaign as load_campaign
    from rigtwin.api.runs import load_run as load_run
    from rigtwin.api.runs import save_campaign as save_campaign
    from rigtwin.api.runs import save_run as save_run
    from rigtwin.api.sweeps import sweep as sweep
    from rigtwin.errors import UserError as UserError
    from rigtwin.rotor.geometry.rig import Rig as Rig
    from rigtwin.sim.campaign import Campaign as Campaign
    from rigtwin.sim.campaign import Run as Run

# Where each name is defined.
_HOMES = {
    "Campaign": "rigtwin.sim.campaign",
    "Rig": "rigtwin.rotor.geometry.rig",
    "Run": "rigtwin.sim.campaign",
    "UserError": "rigtwin.errors",
    "build_fmu": "rigtwin.api.fmus",
    "check_fmu": "rigtwin.api.checks",
    "compare": "rigtwin.api.comparisons",
    "diagnose": "rigtwin.api.diagnoses",
    "effect": "rigtwin.api.rigs",
    "effects": "rigtwin.api.rigs",
    "estimate": "rigtwin.api.estimates",
    "fit_modes": "rigtwin.api.runs",
    "load_campaign": "rigtwin.api.runs",
    "load_diagnosis": "rigtwin.api.diagnoses",
    "load_rig": "rigtwin.api.rigs",
    "load_run": "rigtwin.api.runs",
    "model_modes": "rigtwin.api.rigs",
    "model_response": "rigtwin.api.rigs",
    "predict": "rigtwin.api.predictions",
    "report": "rigtwin.api.reports",
    "save_campaign": "rigtwin.api.runs",
    "save_run": "rigtwin.api.runs",
    "shipped_rigs": "rigtwin.api.rigs",
    "sweep": "rigtwin.api.sweeps",
}

__all__ = [
    "Campaign",
    "Rig",
    "Run",
    "UserError",
    "build_fmu",
    "check_fmu",
    "compare",
    "diagnose",
    "effect",
    "effects",
    "estimate",
    "fit_modes",
    "load_campaign",
    "load_diagnosis",
    "load_rig",
    "load_run",
    "model_modes",
    "model_response",
    "predict",
    "report",
    "save_campaign",
    "save_run",
    "shipped_rigs",
    "sweep",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
