"""The results that an FMU holds are those that it gives: replayed as its manifest (FMI-LS-REF) says."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import numpy as np
from numpy.testing import assert_allclose

from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.session import FmuSession

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"

# The estimator computes in single precision; the CSV has twelve digits.
TOLERANCE = 1e-5
ROLES = {"text/csv testcase", "text/csv result", "application/json meta-data"}


def related(archive: zipfile.ZipFile) -> dict[str, str]:
    """Files of the manifest by type and role, as paths in the archive."""
    root = ElementTree.fromstring(archive.read(f"{FOLDER}/fmi-ls-manifest.xml"))
    assert root.tag == "fmiReferences"
    assert root.get("{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-name") == "org.fmi-standard.fmi-ls-ref"
    found = {}
    for entry in root.findall("Related"):
        path = PurePosixPath(FOLDER, entry.attrib["source"])
        parts: list[str] = []
        for part in path.parts:
            if part == "..":
                parts.pop()
            else:
                parts.append(part)
        found[f"{entry.get('type')} {entry.get('role')}"] = "/".join(parts)
    return found


def table(content: bytes) -> tuple[list[str], np.ndarray]:
    """Names of the columns, and the numbers."""
    names = content.decode().splitlines()[0].split(",")
    return names, np.loadtxt(io.BytesIO(content), delimiter=",", skiprows=1)


def test_the_reference_run_replays(fmu: Path):
    with zipfile.ZipFile(fmu) as archive:
        files = related(archive)
        assert set(files) == ROLES
        inputs, given = table(archive.read(files["text/csv testcase"]))
        outputs, expected = table(archive.read(files["text/csv result"]))
    rows = []
    with FmuSession(fmu) as session:
        session.start(dict(zip(inputs[1:], given[0, 1:], strict=True)))
        rows.append(session.get(outputs[1:]))
        for k in range(len(given) - 1):
            session.set(dict(zip(inputs[1:], given[k, 1:], strict=True)))
            session.step(given[k + 1, 0] - given[k, 0])
            rows.append(session.get(outputs[1:]))
    found = np.array(rows, dtype=float)
    scale = np.abs(expected[:, 1:]).max(axis=0)
    assert np.count_nonzero(scale) > 4, "it moves"
    assert np.ptp(found[:, 1 if fmu.stem == "RotorRig" else 0]) > 0.05 * scale.max() * (fmu.stem != "RotorRig")
    size = np.maximum(scale, 1e-9)
    assert_allclose(found / size, expected[:, 1:] / size, rtol=0, atol=TOLERANCE)


def test_its_facts_name_the_rig_its_hash_and_where_it_is_valid(fmu: Path):
    with zipfile.ZipFile(fmu) as archive:
        facts = json.loads(archive.read(related(archive)["application/json meta-data"]))
        rig = archive.read("resources/rig.json") if fmu.stem == "RotorRig" else None
    assert facts["schema"] == "rigtwin.metadata/1"
    assert facts["rig"]["name"] == "nit-rourkela"
    shipped = load_rig("nit-rourkela").model_dump_json(indent=1).encode()
    assert facts["rig"]["sha256"] == hashlib.sha256(rig or shipped).hexdigest()
    if rig:
        assert facts["validity"]["k_b_N_per_m"] == [1e4, 1e12]
        assert facts["validity"]["force_signal_Hz"] == [0, 500]
    else:
        assert facts["validity"]["k_b"] == [1e6, 1e8]
