"""The site is made without a warning, and has a place for every command, parameter and name.

How one could cheat: a reference that names what its own list has, so it is held against the
program; a page that is in no chapter, of which Sphinx warns, as of links that lead nowhere.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import mlscli
from docs.site import build
from mlscli.cli import COMMANDS
from mlscli.cli import commands as program
from mlscli.errors import MlsError
from mlscli.parameters.fields import fields_of
from mlscli.pipeline.parameters import SECTIONS, Parameters, dotted
from mlscli.pipeline.stages.registry import STAGES

pytest.importorskip("sphinx")
pytest.importorskip("furo")

ROOT = Path(__file__).resolve().parent.parent


def test_the_site_has_a_place_for_everything(tmp_path: Path) -> None:
    make = [sys.executable, "-m", "docs.site.build", str(tmp_path)]
    done = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    told = {
        page: (tmp_path / f"reference/{page}.html").read_text(encoding="utf-8")
        for page in ("commands", "parameters", "python")
    }
    assert all(f"mls {name}" in told["commands"] for name in COMMANDS)
    assert "--pose-topic" in told["commands"]
    assert "narrowest" in (tmp_path / "reference/results.html").read_text(encoding="utf-8")
    assert (tmp_path / "reference/results/clearance.schema.json").is_file()
    assert "plaster.max_gap<" in told["parameters"]
    # The notebook was run: no cell failed, and what its cells show stands in the page.
    notebook = (tmp_path / "docs/first-hour-python.html").read_text(encoding="utf-8")
    assert 'src="data:image/png;base64,' in notebook
    assert notebook.count('alt="What the cell shows"') == 1
    for verdict in ("1.8 does not fit", "0.4 fits", "1.0 never seen"):
        assert verdict in notebook
    names = [name for name in mlscli.__all__ if not name.startswith("__")]
    assert all(f'id="mlscli.{name}"' in told["python"] for name in names)


# --- the reference, held against the program ---


def options(name: str, command: click.Command) -> Iterator[tuple[str, str]]:
    """Yield the path of each command and, of each of its parameters, what a user types."""
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            for word in (*parameter.opts, *parameter.secondary_opts):
                yield name, word
        else:
            yield name, parameter.make_metavar(click.Context(command))
    if isinstance(command, click.Group):
        context = click.Context(command)
        for each in command.list_commands(context):
            below = command.get_command(context, each)
            assert below is not None
            yield from options(f"{name} {each}", below)


def missing_options(reference: str) -> list[tuple[str, str]]:
    sections = dict(
        re.findall(r"^## ([^\n]+)\n\n```text\n(.*?)^```", reference, re.DOTALL | re.MULTILINE)
    )
    return [
        (name, word)
        for name, word in options("mls", program)
        if not re.search(rf"(?<![\w-]){re.escape(word)}(?![\w-])", sections.get(name, ""))
    ]


def missing_parameters(reference: str) -> list[str]:
    owners = {"": Parameters, **SECTIONS, **STAGES}.items()
    paths = [dotted(part, name) for part, owner in owners for name in fields_of(owner)]
    return [path for path in paths if f"| `{path}` |" not in reference]


def missing_names(reference: str) -> list[str]:
    told = set(re.findall(r"^\.\. auto\w+:: mlscli\.(\w+)$", reference, re.MULTILINE))
    return [name for name in mlscli.__all__ if name not in told | {"__version__"}]


def test_every_option_of_every_command_has_its_place() -> None:
    reference = build.commands()
    assert missing_options(reference) == []
    shown = "  --pose-gap SECONDS"
    assert shown in reference
    assert ("mls build", "--pose-gap") in missing_options(reference.replace(shown, "  SECONDS", 1))


def test_the_help_of_every_command_fits_80_columns() -> None:
    told = [line for line in build.commands(80).splitlines() if len(line) > 80]
    assert told == []


def test_every_parameter_has_its_place() -> None:
    reference = build.parameters()
    assert missing_parameters(reference) == []
    assert missing_parameters(reference.replace("| `rays.noise` |", "|", 1)) == ["rays.noise"]


def test_every_public_name_has_its_place_and_its_words() -> None:
    reference = build.python()
    assert missing_names(reference) == []
    assert missing_names(reference.replace("mlscli.explore\n", "mlscli.other\n")) == ["explore"]
    for name in mlscli.__all__:
        value = getattr(mlscli, name)
        assert isinstance(value, str) or (value.__doc__ or "").strip(), name


def test_every_exit_status_is_in_the_table() -> None:
    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    table = page.partition("## Exit status")[2]
    told = {
        int(n)
        for row in re.findall(r"^\| ([\d, ]+) \|", table, re.MULTILINE)
        for n in row.split(",")
    }
    kinds, found = [MlsError], {0, 3, 4, 130, 143}
    while kinds:
        kind = kinds.pop()
        kinds += kind.__subclasses__()
        found.add(kind.exit_status)
    assert told == found
