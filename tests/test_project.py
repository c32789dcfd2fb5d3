"""What the project says of itself in several files it says alike: version, Pythons, checks, parts.

How one could cheat: a file that is there but says nothing. So what is said is taken out of each.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import yaml

from mlscli.version import __version__
from mlscli.view.page import SCRIPTS

ROOT = Path(__file__).resolve().parent.parent
NEWEST_PYTHON = 14


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def pyproject() -> dict[str, Any]:
    return tomllib.loads(text("pyproject.toml"))


def pythons() -> list[str]:
    """Return the Pythons that are supported: from the oldest one allowed to the newest."""
    oldest = re.fullmatch(r">=3\.(\d+)", pyproject()["project"]["requires-python"])
    assert oldest
    return [f"3.{minor}" for minor in range(int(oldest[1]), NEWEST_PYTHON + 1)]


def test_one_version_is_named_everywhere() -> None:
    # The package's is read from the same line when it is built.
    assert pyproject()["project"]["dynamic"] == ["version"]
    attribute = pyproject()["tool"]["setuptools"]["dynamic"]["version"]["attr"]
    assert attribute == "mlscli.version.__version__"
    assert yaml.safe_load(text("CITATION.cff"))["version"] == __version__


def test_the_changelog_tells_of_this_version_and_of_what_comes_next() -> None:
    sections = re.findall(r"^## (\S+)", text("CHANGELOG.md"), flags=re.MULTILINE)
    assert sections[0] == "Unreleased"
    assert __version__ in sections


def test_the_pythons_named_are_those_that_are_checked() -> None:
    ends = (each.rpartition(" :: ")[2] for each in pyproject()["project"]["classifiers"])
    assert [end for end in ends if re.fullmatch(r"3\.\d+", end)] == pythons()
    job = yaml.safe_load(text(".github/workflows/checks.yml"))["jobs"]["test"]
    assert job["strategy"]["matrix"]["python"] == pythons()
    assert job["env"]["PYTHON"] == "python${{ matrix.python }}"


def test_the_workflow_runs_every_check_with_the_libraries_that_ci_installs() -> None:
    job = yaml.safe_load(text(".github/workflows/checks.yml"))["jobs"]["test"]
    commands = [step.get("run", "") for step in job["steps"]]
    assert commands[-1] == "./dev test"
    installed = re.search(r'^LIBRARIES="(.+)"$', text(".ci/run"), re.MULTILINE)
    assert installed
    libraries = [word for word in installed[1].split() if word != "\\"]
    assert "libgl1" in libraries
    assert set(libraries) <= set(" ".join(commands).split())


def test_the_hooks_run_the_checks_of_dev() -> None:
    (repository,) = yaml.safe_load(text(".pre-commit-config.yaml"))["repos"]
    assert repository["repo"] == "local"
    commands = {stage: hook["entry"] for hook in repository["hooks"] for stage in hook["stages"]}
    assert commands == {"pre-commit": "./dev lint", "pre-push": "./dev test"}
    for command in commands.values():
        assert f"\n{command.removeprefix('./dev ')}) " in text("dev")


def test_every_folder_of_modules_is_packaged() -> None:
    folders = {file.parent.relative_to(ROOT) for file in (ROOT / "mlscli").rglob("__init__.py")}
    # The page's parts are no modules, and the presets come from another folder.
    packages = {".".join(folder.parts) for folder in folders} | {"mlscli.view.web"}
    assert set(pyproject()["tool"]["setuptools"]["packages"]) == packages | {"mlscli.presets"}


def test_what_the_linter_lets_scripts_share_they_share() -> None:
    # JSON with comments, each on lines of its own.
    config = json.loads(re.sub(r"^\s*//.*$", "", text(".oxlintrc.json"), flags=re.MULTILINE))
    scripts = {f"mlscli/view/web/{name}": text(f"mlscli/view/web/{name}") for name in SCRIPTS}
    declared = {
        name: re.findall(r"^(?:async )?(?:const|class|function) (\w+)", script, re.MULTILINE)
        for name, script in scripts.items()
    }
    shared = set(config["globals"])
    for name in shared:
        (owner,) = [script for script, names in declared.items() if name in names]
        users = [script for script, code in scripts.items() if re.search(rf"\b{name}\b", code)]
        assert set(users) - {owner}, f"no other script uses {name} of {owner}"
    pattern = config["rules"]["no-unused-vars"][1]["varsIgnorePattern"]
    assert set(pattern.removeprefix("^(").removesuffix(")$").split("|")) == shared


def test_the_tests_that_hold_a_promise_are_there() -> None:
    named = re.findall(r"`([\w/]+\.py)(?:::(test_\w+))?`", text("docs/reliability.md"))
    assert len(named) > 15
    for file, test in named:
        assert not test or f"\ndef {test}(" in text(f"tests/{file}"), file
        assert (ROOT / "tests" / file).is_file(), file
