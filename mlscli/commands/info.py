"""`mls info`: what a recording or a map holds."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report, topics
from mlscli.commands.options import PARTLY_READ, as_json, tell, warn
from mlscli.commands.piped import piped
from mlscli.errors import printable
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap

TEXT = "text cloud"


@click.command()
@click.argument("paths", metavar="FILE...", nargs=-1, required=True, callback=piped)
@click.option("--columns", metavar="LIST", help="Columns of text clouds, as for mls build.")
@click.option(
    "--up",
    default="z",
    metavar="AXIS",
    help="Axis of clouds and reconstructions that points up, as for mls build: extent and levels "
    "are told along it.",
)
@as_json
def command(paths: tuple[str, ...], columns: str | None, up: str, as_json: bool) -> int:
    """Say what recordings or maps hold.

    Of a bag: what each topic is good for, with type, count and frame, how the frames hang together,
    and the time; of a cloud or reconstruction: its keyframes, extent and levels; of a map: patches
    by origin, levels, extent, parameters and sources. With --json, a list of an object for each
    file. Files that cannot be read are told, the others described.
    """
    from mlscli.errors import MlsError, UsageError

    results, status = [], 0
    for path in paths:
        try:
            results.append(_describe(path, columns, up))
        except MlsError as error:
            warn(f"mls: {error}")
            status = max(status, error.exit_status)
    if columns is not None and results and not any(r["kind"] == TEXT for r in results):
        raise UsageError(f"--columns {columns}: none of the files is a text cloud")
    clouds = [r for r in results if "up" in r and r["kind"] != "map"]
    if up != "z" and results and not clouds:
        raise UsageError(f"--up {up}: none of the files is a cloud or a reconstruction")
    if as_json:
        click.echo(json.dumps(results, indent=2))
    elif results:
        tell("\n".join(map(_text, results)))
    partly_read = any(result.get("lost") for result in results)
    return status or (PARTLY_READ if partly_read else 0)


def _describe(path: str, columns: str | None, up: str) -> dict[str, Any]:
    from mlscli.io.writing.npz import is_map, read_map

    if is_map(path) or (path.endswith(".npz") and Path(path).is_file()):
        return _of_map(path, read_map(path))
    return _of_recording(path, columns, up)


def _of_map(path: str, surface: SurfaceMap) -> dict[str, Any]:
    from mlscli.errors import InputError
    from mlscli.geometry import up
    from mlscli.maps.recorded import turn_of
    from mlscli.maps.summary import describe

    try:
        upwards = up.describe(turn_of(surface.meta)[2, :3])
        description = describe(surface)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    result = {"file": path, "kind": "map", **description, "up": upwards}
    return result | {"meta": surface.meta}


def _of_recording(path: str, columns: str | None, up: str) -> dict[str, Any]:
    from mlscli.io.messages.topic import TopicSource
    from mlscli.io.reading.formats import open_source
    from mlscli.io.source import Reading

    source = open_source(Path(path), Reading(columns=columns))
    begin, end = (None if math.isnan(time) else time for time in source.time_span())
    result: dict[str, Any] = {"file": path, "kind": source.kind, "start": begin, "end": end}
    if isinstance(source, TopicSource):
        return result | topics.describe(source)
    return result | _of_cloud(path, columns if source.kind == TEXT else None, up)


def _of_cloud(path: str, columns: str | None, up: str) -> dict[str, Any]:
    """Describe a cloud; its levels are those of cells of the size that `auto` finds."""
    from mlscli.building.build import build
    from mlscli.errors import InputError, with_options
    from mlscli.io.reading.recording import open_recording
    from mlscli.maps.summary import describe
    from mlscli.pipeline.parameters import Parameters

    recording = open_recording(path, columns=columns, up=up)
    keyframes = list(recording.keyframes())
    lows = [keyframe.points.min(axis=0) for keyframe in keyframes if len(keyframe.points)]
    highs = [keyframe.points.max(axis=0) for keyframe in keyframes if len(keyframe.points)]
    notes = [with_options(note) for note in recording.notes]
    try:
        description = describe(build(recording, Parameters(pipeline=())).surface)
    except InputError as error:
        # Few points have an extent, but no size of cells can be found for them.
        place = recording.georeference
        told = None if place is None else place.to_dict() | {"name": place.name, "of": "recording"}
        description = {"cell_size": None, "levels": {}, "georeference": told}
        notes.append(f"levels cannot be told: {with_options(str(error))}")
    return {
        "points": recording.tally.points_read,
        "dropped": recording.tally.dropped,
        "keyframes": len(keyframes),
        "positions": sum(not math.isnan(keyframe.position[0]) for keyframe in keyframes),
        "extent": {
            axis: [float(min(low[i] for low in lows)), float(max(high[i] for high in highs))]
            for i, axis in enumerate("xyz")
        },
        "cell_size": description["cell_size"],
        "levels": description["levels"],
        "up": recording.up,
        "georeference": description["georeference"],
        "notes": notes,
        "lost": recording.losses,
    }


# --- as text ---


def _text(result: dict[str, Any]) -> str:
    head = printable(f"{result['file']}: {result['kind']}")
    if result["kind"] == "map":
        return f"{head}\n{report.lines(_map_rows(result))}"
    if "topics" in result:
        rows = [
            *_remarks(result),
            ("time", _time(result)),
            ("topics", _mappable(result["topics"])),
        ]
        return "\n".join([f"{head}\n{report.lines(rows)}", *topics.lines(result)])
    rows = [
        ("points", f"{result['points']:,} in {some(result['keyframes'], 'keyframe')}"),
        ("dropped", report.counts(result["dropped"])),
        ("time", _time(result)),
        ("route", _route(result)),
        ("extent", report.bounds(result["extent"])),
        ("levels", _levels(result)),
        ("on Earth", report.georeference(result["georeference"])),
        *_remarks(result),
    ]
    return f"{head}\n{report.lines(rows)}"


def _remarks(result: dict[str, Any]) -> list[tuple[str, str]]:
    notes = [("note", note) for note in result["notes"]]
    return [*notes, *[("lost", loss) for loss in result["lost"]]]


def _mappable(topics: list[dict[str, Any]]) -> str:
    count = sum(topic["mappable"] for topic in topics)
    can = "of which none can be mapped" if not count else f"of which {count} can be mapped"
    return f"{len(topics)}, {can}" if topics else "none"


def _levels(result: dict[str, Any]) -> str:
    if not result["levels"]:
        return ""
    size, up = result["cell_size"], result["up"]
    return f"{report.levels(result['levels'])} (cells of {size:.6g}, up is {up})"


def _map_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    # Another program may have written anything into it.
    meta = _mapping(result["meta"])
    points = _mapping(meta.get("points"))
    sources, batches = meta.get("sources"), meta.get("batches", 0)
    return [
        *report.map_rows(result, _mapping(meta.get("sizes"))),
        ("keyframes", f"{result['keyframes']:,} in {_some_batches(batches)}"),
        ("turned", "" if result["up"] == "z" else f"what was {result['up']} is up"),
        ("points", report.counts({n: c for n, c in points.items() if isinstance(c, int)})),
        ("onto", _onto(meta.get("onto"))),
        ("sources", ", ".join(map(str, sources)) if isinstance(sources, list) else ""),
        ("read with", _settings(_mapping(meta.get("reading")))),
        ("made by", str(meta.get("program", ""))),
        *_parameter_rows(_mapping(meta.get("parameters"))),
    ]


def _mapping(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _onto(steps: object) -> str:
    told = [_mapping(step) for step in steps] if isinstance(steps, list) else []
    return ", ".join(f"{step.get('map')}, by its {step.get('by')}" for step in told)


def _some_batches(count: object) -> str:
    return some(count if isinstance(count, int) else 0, "batch")


def _parameter_rows(parameters: dict[str, Any]) -> Iterable[tuple[str, str]]:
    for name, value in parameters.items():
        if name != "pipeline":
            yield name, _settings(value)
    stages = parameters.get("pipeline")
    for entry in stages if isinstance(stages, list) else []:
        for name, settings in _mapping(entry).items():
            yield name, _settings(settings)


def _settings(value: Any) -> str:
    if not isinstance(value, dict):
        return str(value)
    return ", ".join(f"{name}: {given}" for name, given in value.items() if given is not None)


def _time(result: dict[str, Any]) -> str:
    if result["start"] is None:
        return ""
    return f"{result['end'] - result['start']:.3f} s, from {result['start']:.6f}"


def _route(result: dict[str, Any]) -> str:
    known = result["positions"]
    return f"where the craft was is known of {some(known, 'keyframe')}" if known else ""
