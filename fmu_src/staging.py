"""Bundle sources for an FMU under names that no host and no other FMU can own.

Python keeps one module per name in a process. Two FMUs that both bring a ``rigtwin`` package, or a
host that has imported its own, would run each other's code. So every bundled package and script
carries a hash of all that is in the FMU, and only the import lines are rewritten.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import Any
from uuid import UUID, uuid5

# Any fixed UUID: it keeps rigtwin's GUIDs apart from other tools' version-5 UUIDs.
_NAMESPACE = UUID("6f1d4c2e-9a53-5b7e-8f0a-3d2c1b4a5e6f")
_OWN_PACKAGE = "rigtwin"

# What an FMU needs of pythonfmu itself at run time.
PYTHONFMU_MODULES = ("__init__", "_version", "default_experiment", "enums", "fmi2slave", "logmsg", "variables")


def guid(digest: str) -> str:
    """GUID of an FMU; the same content always gives the same one."""
    return str(uuid5(_NAMESPACE, digest))


@dataclass(frozen=True)
class Bundle:
    """What goes into one FMU.

    ``script`` is the slave's module, ``modules`` the modules it needs ("rigtwin.rotor.model.system"), ``data``
    the resource files by name, ``facts`` what the slave is told in its manifest.
    """

    script: str
    modules: Sequence[str]
    data: Mapping[str, bytes]
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """SHA-256 of everything that can change what the FMU does."""
        h = hashlib.sha256(f"pythonfmu {version('pythonfmu')} rigtwin {version('rigtwin')}".encode())
        for name in (self.script, *sorted(self.modules)):
            h.update(name.encode() + _source(name).encode())
        for name in sorted(self.data):
            h.update(name.encode() + self.data[name])
        h.update(json.dumps(self.facts).encode())
        return h.hexdigest()

    @property
    def guid(self) -> str:
        """See ``guid``."""
        return guid(self.digest)

    def rename(self, package: str) -> str:
        """Name of a package inside this FMU."""
        return f"{package}_{self.digest[:8]}"


def modules_of(packages: Sequence[str]) -> tuple[str, ...]:
    """Names of all modules of some packages."""
    return tuple(
        f"{package}.{module.name}"
        for package in packages
        for module in iter_modules(import_module(package).__path__)
        if not module.ispkg
    )


def stage(bundle: Bundle, manifest: str, folder: Path) -> Path:
    """Write the bundle's sources and data into an empty folder; returns the slave's script."""
    for module in bundle.modules:
        package, *inner, name = module.split(".")
        target = folder / bundle.rename(package)
        for level in ("", *inner):
            target = target / level
            target.mkdir(exist_ok=True)
            (target / "__init__.py").touch()
        (target / f"{name}.py").write_text(rewrite_imports(_source(module), bundle, _OWN_PACKAGE), encoding="utf-8")
    for name, content in bundle.data.items():
        (folder / name).write_bytes(content)
    (folder / "manifest.json").write_text(manifest, encoding="utf-8")
    script = folder / f"{bundle.rename(bundle.script.split('.')[-1])}.py"
    script.write_text(rewrite_imports(_source(bundle.script), bundle, _OWN_PACKAGE), encoding="utf-8")
    return script


def rewrite_imports(source: str, bundle: Bundle, package: str) -> str:
    """Point ``from package.module import name`` lines at the renamed package."""
    return re.sub(rf"^from {package}(?=[. ])", f"from {bundle.rename(package)}", source, flags=re.MULTILINE)


def hide_pythonfmu(resources: Path, bundle: Bundle) -> None:
    """Rename the pythonfmu package inside an unpacked FMU, and drop what only a builder needs."""
    stock, hidden = resources / "pythonfmu", resources / bundle.rename("pythonfmu")
    hidden.mkdir()
    for name in PYTHONFMU_MODULES:
        shutil.copy2(stock / f"{name}.py", hidden)
    (hidden / "__init__.py").write_text("", encoding="utf-8")
    shutil.rmtree(stock)
    for path in resources.rglob("*.py"):
        path.write_text(rewrite_imports(path.read_text(encoding="utf-8"), bundle, "pythonfmu"), encoding="utf-8")


def _source(module: str) -> str:
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).read_text(encoding="utf-8")
