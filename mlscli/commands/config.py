"""``mls config``: write, show and check parameters."""

from __future__ import annotations

import click

from mlscli.commands.options import as_json, configured, overwrite, say, setting
from mlscli.commands.piped import piped
from mlscli.errors import ConfigError


@click.group(no_args_is_help=False)
def command() -> None:
    """Write, show and check parameters."""


@command.command()
@click.option("--preset", default="default", metavar="NAME", help="default, plain or thesis.")
@click.option(
    "-o",
    "--output",
    default="params.yaml",
    show_default=True,
    metavar="FILE",
    help="The file to write; - prints.",
)
@overwrite
def init(preset: str, output: str, overwrite: bool) -> None:
    """Write a preset with its comments to a file, to be edited."""
    from mlscli.config import preset_text
    from mlscli.io.writing.atomic import atomic_write

    text = preset_text(preset)
    if output == "-":
        click.echo(text, nl=False)
        return
    with atomic_write(output, overwrite=overwrite) as stream:
        stream.write(text.encode())
    say(f"{output}: written; use it with -c {output}")


@command.command()
@configured
@as_json
def show(config: str | None, settings: tuple[str, ...], as_json: bool) -> None:
    """Print the parameters in force, each with its unit and range."""
    from mlscli.config import load, to_yaml
    from mlscli.pipeline.parameters import to_dict

    parameters = load(config, settings)
    if as_json:
        import json

        click.echo(json.dumps(to_dict(parameters), indent=2))
    else:
        click.echo(to_yaml(parameters), nl=False)


@command.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...", callback=piped)
@setting
def check(files: tuple[str, ...], settings: tuple[str, ...]) -> None:
    """Check configurations or presets, with settings on top, and report every fault in them.

    Where cell_size is auto, faults that would show for some sizes of cells only are told, too.
    """
    from mlscli.config import load
    from mlscli.pipeline.parameters import conditional_faults

    faults: list[str] = []
    for name in files:
        try:
            conditional = conditional_faults(load(name, settings))
        except ConfigError as error:
            faults += error.faults
        else:
            say(f"{name}: ok")
            for fault in conditional:
                say(f"{name}: but not for {fault}")
    if faults:
        raise ConfigError(faults)
