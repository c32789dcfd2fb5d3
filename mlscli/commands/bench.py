"""`mls bench`: what the stages are worth, and how long a batch takes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mlscli.commands.options import as_json, configured, overwrite, say
from mlscli.commands.progress import ProgressBar

if TYPE_CHECKING:
    from mlscli.pipeline.parameters import Parameters


@click.command()
@click.option("--quality", is_flag=True, help="Score synthetic flights, stage by stage.")
@click.option(
    "--scenes",
    metavar="LIST",
    help="Scenes to fly over, such as bridge,house; by default all but the large village.",
)
@click.option(
    "--outliers", metavar="LIST", help="Shares of salt and pepper (default: 0,0.1,0.2,0.3)."
)
@click.option("--seeds", metavar="LIST", help="Seeds, over which the mean is taken (default: 1).")
@click.option(
    "--sizes",
    metavar="SIZES",
    help="Time batches of so many points: A..B, A..B:STEP or a list; 20..400 are the thesis's.",
)
@click.option("--plot", metavar="FILE", help="Draw the times of --sizes: PNG, SVG or PDF.")
@click.option(
    "--compare", metavar="OLD.json", help="Put the times of an earlier --sizes --json beside."
)
@click.option("-o", "--output", metavar="FILE", help="Write the report to a file.")
@configured
@overwrite
@as_json
def command(
    quality: bool,
    scenes: str | None,
    outliers: str | None,
    seeds: str | None,
    sizes: str | None,
    plot: str | None,
    compare: str | None,
    output: str | None,
    config: str | None,
    settings: tuple[str, ...],
    overwrite: bool,
    as_json: bool,
) -> None:
    """Measure what each stage of the pipeline is worth, or how long a batch takes.

    With --quality, every synthetic scene is flown with more and more outliers and mapped with one
    stage more at a time; the maps are scored against the truth. The report is a table in
    Markdown, or JSON with --json. Seeds make it repeatable.

    With --sizes, a flight is cut into batches of each size, which go through the whole pipeline
    into a growing map. The program is warm; what the first batch cost more is said.
    """
    from mlscli.config import load
    from mlscli.errors import UsageError
    from mlscli.io.writing.atomic import atomic_write, refuse_existing

    if quality == (sizes is not None):
        raise UsageError("mls bench: say what to measure: --quality or --sizes 20..400")
    if quality and (plot or compare):
        raise UsageError("--plot and --compare go with --sizes")
    if not quality and (scenes or outliers or seeds):
        raise UsageError("--scenes, --outliers and --seeds go with --quality")
    parameters = load(config, settings)
    for target in (output, plot):
        if target is not None:
            refuse_existing(target, overwrite=overwrite)
    if sizes is None:
        report = _quality(scenes, outliers or "0,0.1,0.2,0.3", seeds or "1", parameters, as_json)
    else:
        report = _pace(sizes, plot, compare, parameters, overwrite, as_json)
    if output is None:
        click.echo(report.rstrip())
        return
    with atomic_write(output, overwrite=overwrite) as stream:
        stream.write(f"{report.rstrip()}\n".encode())
    say(f"mls: {output}: {len(report.splitlines())} lines")


def _quality(
    scenes: str | None, outliers: str, seeds: str, parameters: Parameters, as_json: bool
) -> str:
    from mlscli.errors import UsageError
    from mlscli.trials import quality

    shares, numbers = _numbers("--outliers", outliers), _numbers("--seeds", seeds)
    if not all(number.is_integer() for number in numbers):
        raise UsageError(f"--seeds {seeds}: expected whole numbers")
    names = scenes.split(",") if scenes else quality.SCENES
    with ProgressBar() as progress:
        rows = quality.table(names, shares, list(map(int, numbers)), parameters, progress)
    return json.dumps(quality.to_dict(rows), indent=2) if as_json else quality.to_markdown(rows)


def _pace(
    sizes: str,
    plot: str | None,
    compare: str | None,
    parameters: Parameters,
    overwrite: bool,
    as_json: bool,
) -> str:
    """Time batches and return the report.

    Parameters
    ----------
    sizes : str
        Points in a batch, as `mlscli.trials.pace.parse_sizes` takes them.
    plot : str or None
        The file that the times are drawn in.
    compare : str or None
        A file with an earlier report in JSON, whose times are put beside.
    parameters : Parameters
        Those of the map.
    overwrite : bool
        Whether `plot` may exist.
    as_json : bool
        Whether the report is JSON or Markdown.
    """
    from mlscli.errors import InputError
    from mlscli.plot import require_format, write_figure
    from mlscli.trials import pace

    numbers = pace.parse_sizes(sizes)
    if plot is not None:
        require_format(plot)
    before = None
    if compare is not None:
        try:
            before = pace.seconds_of(json.loads(Path(compare).read_bytes()), compare)
        except ValueError:
            raise InputError(f"{compare}: is no JSON; expected that of --sizes --json") from None
    with ProgressBar() as progress:
        found = pace.measured(numbers, parameters, progress)
    if plot is not None:
        write_figure(plot, pace.drawn(found), overwrite=overwrite)
    if as_json:
        return json.dumps(pace.to_dict(found, before), indent=2)
    return pace.to_markdown(found, before)


def _numbers(option: str, text: str) -> list[float]:
    from mlscli.errors import UsageError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"{option} {text}: expected numbers, separated by commas") from None
