"""`mls bench`: what the stages are worth."""

from __future__ import annotations

import json

import click

from mlscli.commands.options import as_json, configured, overwrite, say
from mlscli.commands.progress import ProgressBar


@click.command()
@click.option("--quality", is_flag=True, help="Score synthetic flights, stage by stage.")
@click.option(
    "--scenes",
    metavar="LIST",
    help="Scenes to fly over, such as bridge,house; by default all but the large village.",
)
@click.option(
    "--outliers",
    default="0,0.1,0.2,0.3",
    metavar="LIST",
    help="Shares of salt and pepper (default: 0,0.1,0.2,0.3).",
)
@click.option(
    "--seeds", default="1", metavar="LIST", help="Seeds, over which the mean is taken (default: 1)."
)
@click.option("-o", "--output", metavar="FILE", help="Write the report to a file.")
@configured
@overwrite
@as_json
def command(
    quality: bool,
    scenes: str | None,
    outliers: str,
    seeds: str,
    output: str | None,
    config: str | None,
    settings: tuple[str, ...],
    overwrite: bool,
    as_json: bool,
) -> None:
    """Measure what each stage of the pipeline is worth.

    With --quality, every synthetic scene is flown with more and more outliers and mapped with one
    stage more at a time; the maps are scored against the truth. The report is a table in
    Markdown, or JSON with --json. Seeds make it repeatable.
    """
    from mlscli.config import load
    from mlscli.errors import UsageError
    from mlscli.io.atomic import atomic_write, refuse_existing

    if not quality:
        raise UsageError("mls bench: say what to measure: --quality")
    shares, numbers = _numbers("--outliers", outliers), _numbers("--seeds", seeds)
    if any(number != int(number) for number in numbers):
        raise UsageError(f"--seeds {seeds}: expected whole numbers")
    parameters = load(config, settings)
    if output is not None:
        refuse_existing(output, overwrite=overwrite)

    from mlscli import quality as measured

    names = scenes.split(",") if scenes else measured.SCENES
    with ProgressBar() as progress:
        rows = measured.table(names, shares, list(map(int, numbers)), parameters, progress)
    report = json.dumps(measured.to_dict(rows), indent=2) if as_json else measured.to_markdown(rows)
    if output is None:
        click.echo(report.rstrip())
        return
    with atomic_write(output, overwrite=overwrite) as stream:
        stream.write(f"{report.rstrip()}\n".encode())
    say(f"mls: {output}: {len(rows)} rows")


def _numbers(option: str, text: str) -> list[float]:
    from mlscli.errors import UsageError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"{option} {text}: expected numbers, separated by commas") from None
