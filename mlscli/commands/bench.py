"""`mls bench`: what the stages are worth, and how long a batch takes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import click

from mlscli.commands.flying import features, noisy
from mlscli.commands.options import (
    PARTLY_READ,
    as_json,
    configured,
    overwrite,
    refuse_given,
    say,
    tell,
)
from mlscli.commands.piped import piped
from mlscli.commands.progress import ProgressBar
from mlscli.commands.reading import FormatsInHelp, files_named, read_points, reading
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.pipeline.parameters import Parameters
    from mlscli.scenes.noise import Noise
    from mlscli.scenes.scans import Scan

# What goes with --quality, beside how scans are read.
_OF_QUALITY = "scenes", "clouds", "outliers", "seeds", "noise", "sigma"


@click.command(cls=FormatsInHelp)
@click.option("--quality", is_flag=True, help="Score synthetic flights, stage by stage.")
@click.option(
    "--scenes",
    metavar="LIST",
    help="Scenes to fly over, such as bridge,house; by default all but the large village.",
)
@click.option(
    "--cloud",
    "clouds",
    multiple=True,
    metavar="SCAN",
    callback=piped,
    help="A dense scan of a real place, to be flown over in place of scenes; each by itself.",
)
@features
@noisy
@click.option(
    "--outliers",
    metavar="LIST",
    help="Shares of salt and pepper, or with --noise slam of wrong correspondences (default: "
    "0,0.1,0.2,0.3).",
)
@click.option("--seeds", metavar="LIST", help="Seeds, over which the mean is taken (default: 1).")
@click.option(
    "--sizes",
    metavar="SIZES",
    help="Time batches of so many points: A..B, A..B:STEP or a list; 20..400 are the thesis's.",
)
@click.option("--plot", metavar="FILE", help="Draw the times of --sizes: PNG, SVG or PDF.")
@click.option(
    "--compare",
    metavar="OLD.json",
    callback=piped,
    help="Put the times of an earlier --sizes --json beside.",
)
@click.option("-o", "--output", metavar="FILE", help="Write the report to a file; - prints it.")
@configured
@overwrite
@as_json
@reading
def command(
    quality: bool,
    scenes: str | None,
    clouds: tuple[str, ...],
    features: int | None,
    sigma: tuple[float, float],
    noise: Literal["thesis", "slam"],
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
    **selection: Any,
) -> int:
    """Measure what each stage of the pipeline is worth, or how long a batch takes.

    With --quality, every synthetic scene is flown with more and more outliers and mapped with one
    stage more at a time; the maps are scored against the truth. The report is a table in
    Markdown, or JSON with --json. Seeds make it repeatable. Cells are 0.15, as the thesis has
    them, with --noise slam of a size found from each flight, unless the configuration says a size.

    With --quality --cloud SCAN, flights are those of mls synth --cloud, in cells of a size found
    from each flight, and the meshes of the maps are scored against the scan, as mls compare --cloud
    does, at the distance of a cell. A scan is read as mls build would, with the same options:
    FORMATS.

    With --sizes, a flight is cut into batches of each size, which go through the whole pipeline
    into a growing map. The program is warm; what the first batch cost more is said.
    """
    from mlscli.config import load
    from mlscli.errors import UsageError
    from mlscli.io.writing.atomic import atomic_write, refuse_existing
    from mlscli.scenes.noise import Noise
    from mlscli.scenes.surfaces import Scatter

    if quality == (sizes is not None):
        raise UsageError("mls bench: say what to measure: --quality or --sizes 20..400")
    if quality:
        refuse_given("goes with --sizes", "plot", "compare")
    else:
        refuse_given("goes with --quality", *_OF_QUALITY)
    if clouds:
        refuse_given("names scenes, and --cloud is a scan", "scenes")
    else:
        refuse_given("goes with --cloud SCAN", "features", *selection)
    parameters = load(config, settings)
    output = None if output == "-" else output
    for target in (output, plot):
        if target is not None:
            inputs = filter(None, (*clouds, config, compare, *files_named(selection)))
            refuse_existing(target, overwrite=overwrite, sources=inputs)
    lost = False
    if sizes is not None:
        report = _pace(sizes, plot, compare, parameters, overwrite, as_json)
    else:
        asked = _Asked(
            _numbers("--outliers", outliers or "0,0.1,0.2,0.3"),
            _seeds(seeds or "1"),
            Noise(noise, Scatter(*sigma)),
            parameters,
        )
        if clouds:
            scans, lost = _scans(clouds, selection)
            report = _scan_quality(scans, features, asked, as_json)
        else:
            report = _quality(scenes, asked, as_json)
    if output is None:
        tell(report.rstrip())
    else:
        with atomic_write(output, overwrite=overwrite) as stream:
            stream.write(f"{report.rstrip()}\n".encode())
        say(f"mls: {output}: {some(len(report.splitlines()), 'line')}")
    return PARTLY_READ if lost else 0


class _Asked(NamedTuple):
    """What --quality is asked to measure on each scene or scan, as `quality.table` takes it.

    Attributes
    ----------
    shares : list of float
        Probabilities of salt and pepper.
    seeds : list of int
        Seeds of the flights.
    noise : Noise
        How points are displaced otherwise.
    parameters : Parameters
        Those of the maps.
    """

    shares: list[float]
    seeds: list[int]
    noise: Noise
    parameters: Parameters


def _quality(scenes: str | None, asked: _Asked, as_json: bool) -> str:
    from mlscli.trials import quality

    names = scenes.split(",") if scenes else quality.SCENES
    with ProgressBar() as progress:
        rows = quality.table(names, **asked._asdict(), progress=progress)
    return json.dumps(quality.to_dict(rows), indent=2) if as_json else quality.to_markdown(rows)


def _scan_quality(scans: list[Scan], features: int | None, asked: _Asked, as_json: bool) -> str:
    from mlscli.scenes.scan_flight import FEATURES
    from mlscli.trials import scan_quality

    found = FEATURES if features is None else features
    with ProgressBar() as progress:
        rows = scan_quality.table(scans, **asked._asdict(), features=found, progress=progress)
    if as_json:
        return json.dumps(scan_quality.to_dict(rows), indent=2)
    return scan_quality.to_markdown(rows)


def _scans(clouds: tuple[str, ...], selection: dict[str, Any]) -> tuple[list[Scan], bool]:
    """Return the scans in files, and whether a part of one could not be read."""
    from mlscli.io.reading.recording import open_recording
    from mlscli.scenes.scans import Scan

    recordings = [open_recording(cloud, **selection) for cloud in clouds]
    scans = [
        Scan.of(cloud, read_points(recording))
        for cloud, recording in zip(clouds, recordings, strict=True)
    ]
    return scans, any(recording.losses for recording in recordings)


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
    from mlscli.io.files import read_input
    from mlscli.plot import require_format, write_figure
    from mlscli.trials import pace

    numbers = pace.parse_sizes(sizes)
    if plot is not None:
        require_format(plot)
    before = None
    if compare is not None:
        try:
            before = pace.seconds_of(json.loads(read_input(compare)), compare)
        except OSError as error:
            raise InputError(f"{compare}: cannot be read: {error.strerror or error}") from None
        except (ValueError, RecursionError):
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


def _seeds(text: str) -> list[int]:
    from mlscli.errors import UsageError

    numbers = _numbers("--seeds", text)
    if not all(number.is_integer() for number in numbers):
        raise UsageError(f"--seeds {text}: expected whole numbers")
    return list(map(int, numbers))
