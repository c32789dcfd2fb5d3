"""`mls info`: what a recording or a map holds."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report
from mlscli.commands.build import PARTLY_READ
from mlscli.commands.options import as_json, say

if TYPE_CHECKING:
    from mlscli.io.base import Source
    from mlscli.surface_map import SurfaceMap


@click.command()
@click.argument("paths", metavar="FILE...", nargs=-1, required=True)
@click.option("--columns", metavar="LIST", help="Columns of a text cloud, as for mls build.")
@as_json
def command(paths: tuple[str, ...], columns: str | None, as_json: bool) -> int:
    """Say what recordings or maps hold.

    Of a bag: topics with types, counts and frames, the time, and which topics can be mapped; of a
    cloud or reconstruction: its keyframes, extent and levels; of a map: patches by origin, levels,
    extent, parameters and sources. With --json, a list of an object for each file. Files that
    cannot be read are told, the others described.
    """
    from mlscli.errors import MlsError

    results, status = [], 0
    for path in paths:
        try:
            results.append(_describe(path, columns))
        except MlsError as error:
            say(f"mls: {error}")
            status = max(status, error.exit_status)
    if as_json:
        click.echo(json.dumps(results, indent=2))
    elif results:
        click.echo("\n".join(map(_text, results)))
    partly_read = any(result.get("lost") for result in results)
    return status or (PARTLY_READ if partly_read else 0)


def _describe(path: str, columns: str | None) -> dict[str, Any]:
    from mlscli.io.mapfile import is_map, read_map

    if is_map(path) or (path.endswith(".npz") and Path(path).is_file()):
        return _of_map(path, read_map(path))
    return _of_recording(path, columns)


def _of_map(path: str, surface: SurfaceMap) -> dict[str, Any]:
    from mlscli.summary import describe

    return {"file": path, "kind": "map", **describe(surface), "meta": surface.meta}


def _of_recording(path: str, columns: str | None) -> dict[str, Any]:
    from mlscli.io.base import Reading
    from mlscli.io.formats import open_source

    source = open_source(Path(path), Reading(columns=columns))
    begin, end = (None if math.isnan(time) else time for time in source.time_span())
    result: dict[str, Any] = {"file": path, "kind": source.kind, "start": begin, "end": end}
    if source.topics():
        return result | {"topics": _topics(source)}
    return result | _of_cloud(path, columns)


def _topics(source: Source) -> list[dict[str, Any]]:
    from mlscli.io.placing import why_not_mapped

    rows = []
    for topic, why_not in zip(source.topics(), why_not_mapped(source), strict=True):
        rows.append(
            {
                "name": topic.name,
                "type": topic.type,
                "messages": topic.count,
                "frame": topic.frame,
                "mappable": not why_not,
                "why_not": why_not,
            }
        )
    return rows


def _of_cloud(path: str, columns: str | None) -> dict[str, Any]:
    """Describe a cloud as recorded, its levels in cells of the size that `auto` gives."""
    from mlscli.config import Parameters
    from mlscli.io.recording import open_recording
    from mlscli.pipeline.builder import build
    from mlscli.summary import describe

    recording = open_recording(path, columns=columns)
    keyframes = list(recording.keyframes())
    lows = [keyframe.points.min(axis=0) for keyframe in keyframes if len(keyframe.points)]
    highs = [keyframe.points.max(axis=0) for keyframe in keyframes if len(keyframe.points)]
    unfiltered = Parameters(pipeline=())
    description = describe(build(recording, unfiltered).surface)
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
        "notes": recording.notes,
        "lost": recording.losses,
    }


# --- as text ---


def _text(result: dict[str, Any]) -> str:
    head = f"{result['file']}: {result['kind']}"
    if result["kind"] == "map":
        return f"{head}\n{report.lines(_map_rows(result))}"
    if "topics" in result:
        rows = [("time", _time(result)), ("topics", f"{len(result['topics'])}")]
        return "\n".join([f"{head}\n{report.lines(rows)}", *_topic_lines(result["topics"])])
    rows = [
        ("points", f"{result['points']:,} in {report.some(result['keyframes'], 'keyframe')}"),
        ("dropped", report.counts(result["dropped"])),
        ("time", _time(result)),
        ("route", _route(result)),
        ("extent", report.bounds(result["extent"])),
        ("levels", f"{report.levels(result['levels'])} (cells of {result['cell_size']:.6g})"),
        *[("note", note) for note in result["notes"]],
        *[("lost", loss) for loss in result["lost"]],
    ]
    return f"{head}\n{report.lines(rows)}"


def _map_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    meta = result["meta"]
    points = meta.get("points", {})
    return [
        *report.map_rows(result),
        ("keyframes", f"{result['keyframes']:,} in {report.some(meta.get('batches', 0), 'batch')}"),
        ("points", report.counts({n: c for n, c in points.items() if isinstance(c, int)})),
        ("sources", ", ".join(meta.get("sources", []))),
        ("read with", _settings(meta.get("reading", {}))),
        ("made by", str(meta.get("program", ""))),
        *_parameter_rows(meta.get("parameters", {})),
    ]


def _parameter_rows(parameters: dict[str, Any]) -> Iterable[tuple[str, str]]:
    for name, value in parameters.items():
        if name != "pipeline":
            yield name, _settings(value)
    for entry in parameters.get("pipeline", []):
        for name, settings in entry.items():
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
    return f"where the craft was is known of {report.some(known, 'keyframe')}" if known else ""


def _topic_lines(topics: list[dict[str, Any]]) -> Iterable[str]:
    widths = [max(len(str(topic[key])) for topic in topics) for key in ("name", "type", "messages")]
    for topic in topics:
        frame = f"  frame {topic['frame']!r}" if topic["frame"] else ""
        # The types that can be mapped are named once, below.
        why_not = topic["why_not"].partition("; can be mapped:")[0]
        can = "can be mapped" if topic["mappable"] else f"not mapped: {why_not}"
        yield (
            f"    {topic['name']:<{widths[0]}}  {topic['type']:<{widths[1]}}  "
            f"{topic['messages']:>{widths[2]}}  {can}{frame}"
        )
    if not any(topic["mappable"] for topic in topics):
        from mlscli.io.messages import MAPPABLE

        yield f"  can be mapped: {MAPPABLE}"
