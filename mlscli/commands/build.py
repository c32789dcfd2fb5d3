"""`mls build`: from recordings to a map."""

from __future__ import annotations

import json
import math
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import dryrun, report
from mlscli.commands.options import (
    PARTLY_READ,
    Size,
    Span,
    as_json,
    configured,
    overwrite,
    say,
    tell,
    warn,
)
from mlscli.commands.piped import STANDARD_INPUT, piped
from mlscli.commands.progress import ProgressBar
from mlscli.commands.reading import FormatsInHelp, files_named, georeferenced, reading
from mlscli.errors import UsageError
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.building.build import Build
    from mlscli.building.builder import Follower
    from mlscli.building.large import LargeBuild
    from mlscli.building.onto import Earlier
    from mlscli.maps.change import Change
    from mlscli.pipeline.parameters import Parameters
    from mlscli.pipeline.report import Report


# Endings of other formats, which would mislead other programs.
_NO_MAPS = (
    *(".ply", ".obj", ".glb", ".mcap", ".bag", ".pcd", ".las", ".laz", ".html", ".png"),
    *(".yaml", ".yml", ".bt", ".nc", ".tif", ".tiff", ".sdf", ".world"),
)

# What --onto and --keep-points do not go with, and why.
_WHY = {
    "--memory": "as the points of the map are held in memory",
    "--dry-run": "which writes no map and adds to none",
    "--resume": "as a checkpoint keeps no points",
    "--checkpoint-every": "as a checkpoint keeps no points",
}


@click.command(cls=FormatsInHelp)
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, callback=piped)
@click.option(
    "-o",
    "--output",
    metavar="MAP",
    help="The map's file; by default the first source's name with .npz, in the current folder.",
)
@click.option(
    "--free-space",
    is_flag=True,
    help="Also keep in the map what space was seen through: how many sight lines, from the craft "
    "to points, passed through each voxel. The same as --set map.free_space=true.",
)
@click.option(
    "--growing",
    is_flag=True,
    help="Bring the map up to date after every batch, as on board, and say how long the slowest "
    "took. The map is the same. The sequential mode always does.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Read the first keyframes only, and say what the build would do and how long it would "
    "take; write nothing.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Evaluate the map tile by tile in N threads. The map is the same.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Hand the tiles to the Dask cluster whose scheduler this is, tcp://host:port; local: to "
    "one on this machine that Dask starts. The map is the same. "
    "Needs pip install 'mlscli[dask]'.",
)
@click.option(
    "--memory",
    type=Size(),
    metavar="SIZE",
    help="Take no more memory than this, such as 2G or 500M: points and tiles of the map lie on "
    "disk meanwhile. The map is the same; map.cell_size must be a number. Clouds that "
    "are no bags are held in memory all the same.",
)
@click.option(
    "--scratch",
    metavar="DIR",
    help="The folder for what --memory leaves no room for; by default the system's for temporary "
    "files. Nothing stays there.",
)
@click.option(
    "--checkpoint-every",
    type=Span(),
    metavar="TIME",
    help="With --memory, --scheduler or --jobs: every 30s, 10m or 2h, keep the tiles evaluated so "
    "far in the folder MAP.checkpoint, for --resume. It is removed when the map is written.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on from the checkpoint of this build, which was interrupted: the sources are read "
    "again, and what was evaluated is not evaluated again. The map is the same.",
)
@click.option(
    "--replay",
    metavar="FILE",
    help="Write the map as it grew, too: an MCAP file for Lichtblick, Foxglove and RViz, with the "
    "recording's times.",
)
@click.option(
    "--keep-points",
    is_flag=True,
    help="Keep the points in the map's file, too, 24 bytes each, so that --onto can add a flight "
    "as if both had been built together.",
)
@click.option(
    "--onto",
    metavar="MAP",
    help="Add the recording to this map, with its parameters: bit for bit as if both had been "
    "built together, if it was built with --keep-points, else batch by batch, as the sequential "
    "mode merges.",
)
@configured
@reading
@georeferenced
@overwrite
@as_json
def command(
    sources: tuple[str, ...],
    output: str | None,
    free_space: bool,
    growing: bool,
    dry_run: bool,
    jobs: int | None,
    scheduler: str | None,
    memory: int | None,
    scratch: str | None,
    checkpoint_every: float | None,
    resume: bool,
    replay: str | None,
    keep_points: bool,
    onto: str | None,
    config: str | None,
    settings: tuple[str, ...],
    overwrite: bool,
    as_json: bool,
    **selection: Any,
) -> int:
    """Build a multi-level surface map from a recording.

    Can be read, recognised by content: FORMATS. Several SOURCEs are read in turn, as one flight.
    """
    from mlscli.building.build import Build, build
    from mlscli.building.large import build_large
    from mlscli.building.onto import build_onto, parameters_of
    from mlscli.building.sizes import given_size_doubts
    from mlscli.config import load
    from mlscli.io.reading.recording import open_recording
    from mlscli.io.writing.atomic import is_same, refuse_existing
    from mlscli.io.writing.npz import write_map
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.pipeline.tilewise.checkpoint import Checkpoint, folder_of
    from mlscli.pipeline.tilewise.connection import connected

    begin = time.perf_counter()
    _check_kept(
        {"--onto": onto, "--keep-points": keep_points or None},
        {"--memory": memory, "--dry-run": dry_run or None, "--resume": resume or None}
        | {"--checkpoint-every": checkpoint_every},
    )
    if free_space:
        settings = (*settings, "map.free_space=true")
    earlier = None if onto is None else _earlier(onto)
    if earlier is None:
        parameters = load(config, settings)
    else:
        parameters = parameters_of(earlier, config, settings)
        _check_tiles(earlier, {"--jobs": jobs, "--scheduler": scheduler})
    _check_together(parameters, growing or replay is not None, jobs, scheduler, memory, scratch)
    keeps = resume or checkpoint_every is not None
    if keeps and jobs is None and scheduler is None and memory is None:
        named = "--resume" if resume else "--checkpoint-every"
        raise UsageError(
            f"{named}: needs a map that is evaluated tile by tile; "
            "add --memory, --scheduler or --jobs"
        )
    target = output or default_output(sources[0])
    if Path(target).suffix.lower() in _NO_MAPS:
        raise UsageError(f"{target}: a map is a .npz file; mls export makes others of it")
    inputs = [*sources, *files_named(selection), *filter(None, (config, onto))]
    refuse_existing(target, overwrite=overwrite, sources=inputs)
    if replay is not None:
        if is_same(replay, target):
            raise UsageError(f"--replay {replay}: is the map's name; choose another")
        refuse_existing(replay, overwrite=overwrite, sources=inputs)
    if dry_run:
        grows = _nobody if growing or replay is not None else None
        return dryrun.report_build(target, sources, parameters, grows, selection, as_json=as_json)
    if not keeps and folder_of(target).exists():
        say(f"mls: {folder_of(target)}: is of an interrupted build, and not used without `resume`")
    recording = open_recording(*sources, **selection)
    notes = recording.notes
    for note in notes:
        say(f"mls: {note}")

    with ProgressBar() as progress, ExitStack() as stack:
        checkpoint = None
        if keeps:
            checkpoint = stack.enter_context(
                Checkpoint(target, every=checkpoint_every, resume=resume, overwrite=overwrite)
            )
        follow: Follower | None = _nobody if growing else None
        if replay is not None:
            from mlscli.view.replay import open_replay

            played = stack.enter_context(open_replay(replay, overwrite=overwrite))
            follow = played.follow
        built: Build | LargeBuild
        if earlier is not None:
            cluster = None if scheduler is None else stack.enter_context(connected(scheduler))
            shared = jobs, cluster
            built = build_onto(
                earlier, recording, parameters, progress, follow, *shared, keep_points=keep_points
            )
        elif memory is None:
            built = build(
                recording,
                parameters,
                progress,
                follow,
                jobs,
                scheduler,
                checkpoint,
                keep_points=keep_points,
            )
        else:
            large = build_large(
                recording,
                parameters,
                memory,
                scratch=scratch,
                jobs=jobs,
                scheduler=scheduler,
                progress=progress,
                checkpoint=checkpoint,
            )
            built = stack.enter_context(large)
        with built.report.timed("writing"):
            points = built.points if isinstance(built, Build) else None
            write_map(target, built.surface, points=points, overwrite=overwrite)
        if checkpoint is not None:
            checkpoint.clear()
        if replay is not None and isinstance(built.surface, SurfaceMap):
            played.finish(built.surface)
        account = _account(target, built, parameters, recording.losses)
        account |= {} if earlier is None else {"onto": earlier.how}
        account |= {} if points is None else {"points_kept": len(points.xyz)}
    for note in recording.notes:
        if note not in notes:
            say(f"mls: {note}")
    for loss in recording.losses:
        warn(f"mls: warning: {loss}")
    for doubt in given_size_doubts(account, account["vehicle"]["height"], recording.tally.step):
        say(f"mls: {doubt}")
    seconds = time.perf_counter() - begin
    account |= {"seconds": {"total": seconds, **built.report.seconds}}
    account |= {"points_per_second": account["points"]["read"] / seconds}
    click.echo(json.dumps(account, indent=2)) if as_json else tell(_text(account, parameters))
    return PARTLY_READ if recording.losses else 0


def default_output(source: str) -> str:
    """Return the name of the map where none is given: the source's stem and ``.npz``.

    Raises
    ------
    UsageError
        The source is standard input.
    """
    if source == STANDARD_INPUT:
        raise UsageError("SOURCE -: standard input has no name to take; add one, as -o map.npz")
    path = Path(source).resolve()
    # A folder's name has no ending to take off.
    return f"{path.name if path.is_dir() else path.stem}.npz"


def _check_kept(given: dict[str, object], options: dict[str, object]) -> None:
    """Refuse --onto and --keep-points with what they do not go with, by the options' values."""
    names = [name for name, value in given.items() if value is not None]
    for name, value in options.items():
        if names and value is not None:
            raise UsageError(f"{names[0]}: does not go with {name}, {_WHY[name]}; leave it out")


def _check_tiles(earlier: Earlier, options: dict[str, object]) -> None:
    """Refuse workers for a map without points, to which a recording is added batch by batch."""
    for name, value in options.items():
        if value is not None and earlier.points is None:
            raise UsageError(
                f"{name}: {earlier.name} kept no points, so that the recording is added batch by "
                "batch and not tile by tile; leave it out, or build the map with --keep-points"
            )


def _earlier(file: str) -> Earlier:
    """Read a map to build onto, with its points, if they were kept."""
    from mlscli.building.onto import Earlier
    from mlscli.io.writing.npz import read_map, read_points

    return Earlier(file, read_map(file), read_points(file))


def _check_together(
    parameters: Parameters,
    followed: bool,
    jobs: int | None,
    scheduler: str | None,
    memory: int | None,
    scratch: str | None,
) -> None:
    """Refuse options that do not go together.

    Parameters
    ----------
    parameters : Parameters
        Those of the map.
    followed : bool
        Whether the map is brought up to date after every batch: --growing or --replay.
    jobs, scheduler, memory, scratch
        The values of these options, None where not given; `memory` in bytes.

    Raises
    ------
    UsageError
        Naming the options.
    """
    from mlscli.building.builder import check_workers

    growing = "--growing or --replay" if followed else ""
    check_workers(parameters, {"jobs": jobs, "scheduler": scheduler}, growing)
    check_workers(parameters, {"memory": memory}, growing)
    if scheduler is not None:
        from mlscli.pipeline.tilewise.connection import check_address, refuse_local

        check_address(scheduler)
        if memory is not None:
            refuse_local(scheduler)
    if scratch is not None and memory is None:
        raise UsageError("--scratch: says where --memory puts what it leaves no room for; add it")


def _nobody(change: Change) -> None:
    """Ignore a change: having a follower keeps the map up to date after every batch."""


def _account(
    target: str, built: Build | LargeBuild, parameters: Parameters, losses: list[str]
) -> dict[str, Any]:
    from mlscli.maps.summary import describe

    surface = built.surface
    meta = surface.meta
    return {
        "map": target,
        **describe(built.surface),
        "sizes": meta["sizes"],
        "vehicle": parameters.vehicle.in_units(surface.grid.cell_size),
        "points": meta["points"],
        "keyframes": meta["keyframes"],
        "batches": meta["batches"],
        "mode": meta["parameters"]["mode"],
        "lost": losses,
        "pace": _pace(built.report, surface.route[:, 0].tolist()),
    }


def _pace(made: Report, stamps: list[float]) -> dict[str, float | None] | None:
    """Return how long (s) the slowest batch took, and the flight lasted for each batch on average.

    None where the map did not grow by batches.
    """
    if made.slowest_batch is None:
        return None
    known = [stamp for stamp in stamps if math.isfinite(stamp)]
    flight = max(known) - min(known) if known else 0.0
    return {
        "slowest_batch": made.slowest_batch,
        "flight_per_batch": flight / made.batches if flight > 0 else None,
    }


def _pace_row(pace: dict[str, float | None] | None) -> str:
    if pace is None:
        return ""
    slowest, flight = pace["slowest_batch"], pace["flight_per_batch"]
    own = "the flight has no times" if flight is None else f"the flight took {flight:.3g} s a batch"
    return f"slowest batch {slowest:.3g} s; {own}"


def _kept(account: dict[str, Any]) -> str:
    count = account.get("points_kept")
    return "" if count is None else f"{some(count, 'point')}, for --onto"


def _text(account: dict[str, Any], parameters: Parameters) -> str:
    points, seconds = account["points"], dict(account["seconds"])
    dropped = [f"{count:,} dropped ({reason})" for reason, count in points["dropped"].items()]
    total = seconds.pop("total")
    batches = some(account["batches"], "batch")
    longest_first = sorted(seconds.items(), key=lambda item: -item[1])
    rows = [
        (
            "points",
            f"{points['read']:,} read: " + ", ".join([f"{points['kept']:,} kept", *dropped]),
        ),
        ("keyframes", f"{account['keyframes']:,} in {batches}, {account['mode']}"),
        ("onto", account.get("onto", "")),
        ("kept", _kept(account)),
        *report.map_rows(account, account["sizes"]),
        ("noise", account["sizes"].get("noise", "")),
        ("vehicle", report.craft(parameters.vehicle, account["cell_size"])),
        ("time", f"{total:.2f} s, {account['points_per_second']:,.0f} points/s"),
        ("", ", ".join(f"{what} {spent:.3f}" for what, spent in longest_first)),
        ("pace", _pace_row(account["pace"])),
        ("lost", "; ".join(account["lost"])),
    ]
    return f"{account['map']}\n{report.lines(rows)}"
