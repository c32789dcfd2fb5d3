"""The bill of materials, in CycloneDX 1.6, of what `supply/lock.txt` pins.

    python -m supply.sbom > supply/sbom.cdx.json

What the installed program needs has the scope ``required``; what is needed to work on it, or for
what is installed on request, ``optional``. Hashes of their files are in the lock file.

References
----------
https://cyclonedx.org/docs/1.6/json/
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from mlscli.version import __version__

HERE = Path(__file__).parent
PROJECT = "mlscli"


class Pin(NamedTuple):
    """A package that is pinned.

    Attributes
    ----------
    version : str
    hashes : list of str
        SHA-256 of its files.
    needed_by : list of str
        The packages that need it; `PROJECT` is the project itself.
    """

    version: str
    hashes: list[str]
    needed_by: list[str]


def pins(lock: str) -> dict[str, Pin]:
    """Return the packages that a lock file pins, by name."""
    found: dict[str, Pin] = {}
    for entry in re.split(r"\n(?=\S)", f"\n{lock}"):
        head = re.match(r"\s*([\w.-]+)==([^\s;\\]+)", entry)
        if head is not None:
            needs = re.findall(r"^\s+# (?:via|  ) *([\w.-]+)", entry, re.MULTILINE)
            hashes = re.findall(r"--hash=sha256:([0-9a-f]{64})", entry)
            found[head[1]] = Pin(head[2], hashes, needs)
    return found


def _required(packages: dict[str, Pin], direct: list[str]) -> set[str]:
    """Return the packages that these need, and they themselves."""
    required = {name for name in direct if name in packages}
    while True:
        more = {n for n, pin in packages.items() if required & set(pin.needed_by)} - required
        if not more:
            return required
        required |= more


def bill(lock: str, project: dict[str, Any]) -> dict[str, Any]:
    """Return the bill of materials of a lock file and what pyproject.toml says of the project."""
    packages = pins(lock)
    direct = [re.split(r"[^\w.-]", need)[0].lower() for need in project["dependencies"]]
    required = _required(packages, direct)
    refs = {name: f"pkg:pypi/{name}@{pin.version}" for name, pin in packages.items()}
    own = f"pkg:pypi/{PROJECT}@{__version__}"
    components = [
        {
            "type": "library",
            "bom-ref": refs[name],
            "name": name,
            "version": pin.version,
            "purl": refs[name],
            "scope": "required" if name in required else "optional",
        }
        for name, pin in sorted(packages.items())
    ]
    needs = {own: sorted(refs[name] for name, pin in packages.items() if PROJECT in pin.needed_by)}
    needs |= {
        refs[name]: sorted(refs[n] for n, pin in packages.items() if name in pin.needed_by)
        for name in sorted(packages)
    }
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": PROJECT,
                "version": __version__,
                "purl": own,
                "licenses": [{"license": {"id": project["license"]}}],
            }
        },
        "components": components,
        "dependencies": [{"ref": ref, "dependsOn": on} for ref, on in needs.items()],
    }


def made() -> str:
    """Return the bill of materials of this checkout, as text."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lock = (HERE / "lock.txt").read_text(encoding="utf-8")
    return f"{json.dumps(bill(lock, project), indent=1)}\n"


if __name__ == "__main__":
    sys.stdout.write(made())
