"""Where a result comes from: versions, commit, GUIDs and hashes."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from fmpy import read_model_description

_PACKAGES = ("rigtwin", "numpy", "scipy", "fmpy", "pythonfmu", "onnxruntime")


def provenance(fmus: Sequence[Path] = ()) -> dict[str, str]:
    """What made a page, by name."""
    facts = {"made": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC", "commit": commit()}
    facts |= {package: version(package) for package in _PACKAGES}
    facts["python"] = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    for fmu in fmus:
        facts[fmu.name] = f"GUID {read_model_description(str(fmu)).guid}"
        facts[f"{fmu.name}, SHA-256"] = hashlib.sha256(fmu.read_bytes()).hexdigest()
    return {name: value for name, value in facts.items() if value}


def commit() -> str:
    """Commit of the checkout this runs from; empty where it is installed."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    try:
        command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
