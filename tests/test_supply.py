"""What is pinned is what the project asks for, and what the bill of materials lists.

How one could cheat: pins without hashes; a lock file that pyproject.toml has outgrown.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

from supply.sbom import bill, made, pins

ROOT = Path(__file__).resolve().parent.parent
LOCK = (ROOT / "supply/lock.txt").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_all_that_the_project_asks_for_is_pinned_with_hashes() -> None:
    pinned = pins(LOCK)
    asked = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"]]
    for need in map(Requirement, asked):
        assert pinned[need.name.lower()].version in need.specifier, need
    assert len(pinned) == LOCK.count("==") - LOCK.count("'==") > 100
    assert all(pin.hashes for pin in pinned.values())
    assert "://" not in LOCK


def test_the_bill_of_materials_is_that_of_the_lock_file() -> None:
    assert (ROOT / "supply/sbom.cdx.json").read_text() == made()
    listed = json.loads(made())
    refs = {component["bom-ref"] for component in listed["components"]}
    refs.add(listed["metadata"]["component"]["bom-ref"])
    assert {entry["ref"] for entry in listed["dependencies"]} == refs
    assert {on for entry in listed["dependencies"] for on in entry["dependsOn"]} < refs
    assert all(re.fullmatch(r"pkg:pypi/[a-z0-9-]+@[\w.]+", ref) for ref in refs)


def test_what_the_installed_program_needs_is_told_from_what_its_makers_need() -> None:
    lock = """
a==1 --hash=sha256:00
    # via mlscli (pyproject.toml)
b==2
    # via
    #   a
    #   tool
tool==3 ; python_version < '4'
    # via mlscli (pyproject.toml)
c==4
    # via tool
"""
    listed = bill(lock, {"dependencies": ["A>=1"], "license": "BSD-3-Clause"})
    scopes = {component["name"]: component["scope"] for component in listed["components"]}
    assert scopes == {"a": "required", "b": "required", "tool": "optional", "c": "optional"}
    needs = {entry["ref"]: entry["dependsOn"] for entry in listed["dependencies"]}
    assert needs["pkg:pypi/tool@3"] == ["pkg:pypi/b@2", "pkg:pypi/c@4"]
