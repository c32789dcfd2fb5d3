"""Make the site of the documentation: ``python -m docs.site.build [OUT]`` (./dev docs).

Pages are those of docs/, the README, the benchmarks', CONTRIBUTING.md, SECURITY.md and
CHANGELOG.md, where they are, and the notebook, which is run for it; the reference is made from the
code: commands and their options, parameters, the public names of the package, messages; and from
docs/results.yaml: what `--json` prints. A warning ends it with an error, as of a link or an anchor
that leads nowhere.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import click

from docs.site import messages, results
from docs.site.notebook import NOTEBOOK, page

ROOT = Path(__file__).resolve().parents[2]

INDEX = """# mls

What stands where on your recorded flight, what nobody saw, and whether your craft fits through.

![A hamlet with a bridge over a creek](docs/gallery/hamlet.png)

```{toctree}
:maxdepth: 1
Overview <README>
docs/first-hour
docs/first-hour-python
```
"""

CHAPTERS = {
    "How to": (
        "docs/howto/recordings",
        "docs/howto/sites",
        "docs/howto/large",
        "docs/howto/share",
        "docs/reading",
        "docs/viewing",
        "docs/queries",
        "docs/nav2",
        "docs/octomap",
        "docs/pointclouds",
        "docs/layers",
        "docs/georeference",
        "docs/gazebo",
        "docs/scenes",
        "docs/flights",
        "docs/scoring",
        "docs/commands",
        "docs/messages",
    ),
    "Reference": (
        "reference/commands",
        "reference/parameters",
        "reference/results",
        "reference/messages",
        "reference/python",
    ),
    "How it works": (
        "docs/map",
        "docs/stages",
        "docs/meshes",
        "docs/reliability",
        "docs/gallery",
        "benchmarks/README",
    ),
    "Carrying on": ("docs/design", "CONTRIBUTING", "SECURITY", "CHANGELOG"),
}


def index() -> str:
    """Return the first page: all pages, by chapter."""
    trees = (
        f"```{{toctree}}\n:caption: {caption}\n:maxdepth: 1\n" + "\n".join(pages) + "\n```\n"
        for caption, pages in CHAPTERS.items()
    )
    return "\n".join((INDEX, *trees))


def commands(width: int = 90) -> str:
    """Return the page of all commands: what each prints with ``--help`` on so wide a terminal."""
    from mlscli.cli import commands as program

    return "# Commands and options\n\n" + "\n".join(_helps("mls", program, None, width))


def _helps(
    name: str, command: click.Command, parent: click.Context | None, width: int
) -> Iterator[str]:
    wide = {"terminal_width": width, "max_content_width": width}
    context = command.make_context(name, [], parent=parent, resilient_parsing=True, **wide)
    yield f"## {context.command_path}\n\n```text\n{command.get_help(context)}\n```\n"
    if isinstance(command, click.Group):
        for each in command.list_commands(context):
            below = command.get_command(context, each)
            assert below is not None
            yield from _helps(each, below, context, width)


def parameters() -> str:
    """Return the page of all parameters, by section and stage."""
    from mlscli.parameters.fields import fields_of
    from mlscli.pipeline.parameters import SECTIONS, Parameters
    from mlscli.pipeline.stages.registry import STAGES

    lines = [
        "# Parameters",
        "",
        "In a configuration (`-c FILE`, `mls config init`), or with `--set NAME=VALUE`. Defaults "
        "are those of a section or stage that is named alone; the default pipeline sets others "
        "(`mls config show`).",
    ]
    for name, owner in {"": Parameters, **SECTIONS, **STAGES}.items():
        lines += [
            "",
            f"## {name or 'top'}",
            "",
            "| parameter | default | values | |",
            "|--|--|--|--|",
        ]
        for item in fields_of(owner).values():
            path = f"{name}.{item.name}" if name else item.name
            cells = (f"`{path}`", f"`{item.default_words}`", item.accepts, item.help)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join((*lines, ""))


def python() -> str:
    """Return the page of the public names of the package, in reStructuredText."""
    import mlscli

    lines = ["Python", "======", "", ".. module:: mlscli", ""]
    for name in mlscli.__all__:
        value = getattr(mlscli, name)
        if isinstance(value, type):
            lines += [f".. autoclass:: mlscli.{name}", "   :members:", ""]
        elif callable(value):
            lines += [f".. autofunction:: mlscli.{name}", ""]
    return "\n".join(lines)


def gather(source: Path) -> None:
    """Write all that the site is made of into a folder."""
    for name in (
        "README.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "CHANGELOG.md",
        "LICENSE",
        "CITATION.cff",
    ):
        shutil.copy(ROOT / name, source)
    for folder in ("docs", "benchmarks", "configs", ".github"):
        if (ROOT / folder).is_dir():
            shutil.copytree(
                ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__", "site")
            )
    (source / "index.md").write_text(index(), encoding="utf-8")
    (source / "docs/first-hour-python.md").write_text(
        page(NOTEBOOK, source / "docs"), encoding="utf-8"
    )
    reference = source / "reference"
    reference.mkdir()
    (reference / "commands.md").write_text(commands(), encoding="utf-8")
    (reference / "parameters.md").write_text(parameters(), encoding="utf-8")
    (reference / "results.md").write_text(results.page(), encoding="utf-8")
    (reference / "messages.md").write_text(messages.page(), encoding="utf-8")
    (reference / "python.rst").write_text(python(), encoding="utf-8")


def build(out: Path) -> int:
    """Make the site in a folder; return Sphinx's status."""
    from sphinx.cmd.build import build_main

    with tempfile.TemporaryDirectory() as name:
        source = Path(name)
        gather(source)
        configuration = Path(__file__).parent
        options = ["-q", "-W", "--keep-going", "-c", str(configuration), "-d", f"{name}/.doctrees"]
        status = build_main(["-b", "html", *options, name, str(out)])
    schemas = out / "reference/results"
    schemas.mkdir(parents=True, exist_ok=True)
    for each in results.names():
        text = json.dumps(results.schema(each), indent=2)
        (schemas / f"{each}.schema.json").write_text(f"{text}\n", encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(build(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "site")))
