"""A further recording added to a map.

Where the points of the map were kept, its keyframes come first and those of the recording after
them: the map is that of both, built as one, bit for bit. Otherwise the recording is added to the
patches batch by batch, as the sequential mode does.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from mlscli.building.build import Build, emptied, feed, read
from mlscli.building.builder import Follower, MapBuilder
from mlscli.config import load, loads
from mlscli.errors import ConfigError, InputError, UsageError
from mlscli.io.reading.recording import Recording
from mlscli.keyframes.kept import KeptPoints, PointKeeper
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.georeference import GEOREFERENCE, of_both
from mlscli.maps.merging import meta_of_both, require_same_frame
from mlscli.maps.recorded import TURN, turn_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import AUTO, Parameters, to_dict
from mlscli.pipeline.pipeline import Progress
from mlscli.pipeline.tilewise.cluster import Cluster

ONTO = "onto"
"""The key in a map's meta of how it was added to others: for each, its name and how."""

BY_POINTS, BY_PATCHES = "points", "patches"


class Earlier(NamedTuple):
    """A map to add a recording to.

    Attributes
    ----------
    name : str
        What messages call it.
    surface : SurfaceMap
    points : KeptPoints or None
        Its points, if they were kept.
    """

    name: str
    surface: SurfaceMap
    points: KeptPoints | None

    @property
    def how(self) -> str:
        """How a recording is added to it, in words."""
        if self.points is not None:
            return f"{self.name}, by its points: as if both had been built together"
        return f"{self.name}, which kept no points: batch by batch, as the sequential mode merges"


def parameters_of(
    earlier: Earlier, config: str | None = None, settings: tuple[str, ...] = ()
) -> Parameters:
    """Return the parameters of a map; those that the user gives must be the same.

    Parameters
    ----------
    earlier : Earlier
    config : str, optional
        A configuration, or the name of a preset. What is ``auto`` in it is as the map has it.
    settings : tuple of str
        Settings ``stage.param=value``.

    Raises
    ------
    InputError
        The map's meta holds no parameters.
    UsageError
        Some differ, and which.
    ConfigError
        The configuration is at fault.
    """
    held = earlier.surface.meta.get("parameters")
    text = json.dumps(held)
    try:
        if not isinstance(held, Mapping):
            raise ConfigError(["none"])
        own = loads(text, f"{earlier.name}: meta: parameters")
    except ConfigError as error:
        raise InputError(
            f"{earlier.name}: its meta holds no parameters that are valid here, so that nothing "
            f"can be built onto it: {str(error).splitlines()[0]}"
        ) from None
    given = loads(text, earlier.name, settings) if config is None else load(config, settings)
    found = [*_differences(to_dict(given), to_dict(own))]
    if found:
        raise UsageError(
            f"{earlier.name}: was built with other parameters than those given: "
            f"{'; '.join(found)}; leave these out, or build both anew"
        )
    grid = earlier.surface.grid
    for name in ("cell_size", "gap_size", "thickness"):
        value = getattr(grid, name)
        settled = to_dict(own)["map"][name]
        if isinstance(settled, int | float) and settled != value:
            raise InputError(
                f"{earlier.name}: its meta says {name} {settled}, and its grid has {value}; "
                "nothing can be built onto it"
            )
    return own


def _differences(given: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    """Yield where parameters differ, a few words each."""
    stages = [[next(iter(stage)) for stage in each["pipeline"]] for each in (given, own)]
    if stages[0] != stages[1]:
        mine, its = (", ".join(names) or "none" for names in stages)
        yield f"stages {mine}, where it has {its}"
        return
    for (path, mine), (_, its) in zip(_leaves(given), _leaves(own), strict=True):
        # What is to be found, or follows from another, is as the map has it.
        if mine != its and mine != AUTO and mine is not None:
            yield f"{path} {mine}, where it has {its}"


def _leaves(part: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in part.items():
        if name == "pipeline":
            for stage in value:
                yield from _leaves(stage)
        elif isinstance(value, Mapping):
            yield from _leaves(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def build_onto(
    earlier: Earlier,
    recording: Recording,
    parameters: Parameters,
    progress: Progress | None = None,
    follow: Follower | None = None,
    jobs: int | None = None,
    cluster: Cluster | None = None,
    *,
    keep_points: bool = False,
) -> Build:
    """Add a recording to a map.

    Parameters
    ----------
    earlier : Earlier
    recording : Recording
        In the frame of the map.
    parameters : Parameters
        Those of the map, see `parameters_of`.
    progress, follow, jobs
        As for `mlscli.building.build.build`; `jobs` only where the map's points were kept. Where
        they were not, the first change is the map itself.
    cluster : Cluster, optional
        Whose workers evaluate the tiles, where the map's points were kept; else as `jobs` says.
    keep_points : bool
        Whether the points of both are returned, too.

    Returns
    -------
    Build
        The map of both; its meta says how, under `ONTO`.

    Raises
    ------
    UsageError
        The recording lies in another frame, or in another place on Earth; or points are to be kept
        and those of the map were not.
    MlsError
        As for `build`.
    """
    surface, points = earlier.surface, earlier.points
    if keep_points and points is None:
        raise UsageError(f"`keep_points`: {earlier.name} kept no points; leave it out")
    place = recording.georeference
    mine = {TURN: recording.map_from_recording.tolist()}
    mine |= {} if place is None else {GEOREFERENCE: place.to_dict()}
    try:
        require_same_frame(surface.frame_id, surface.meta, recording.frame_id, mine)
        where = of_both(surface.meta, mine)
    except UsageError as error:
        raise UsageError(f"{', '.join(recording.sources)} onto {earlier.name}: {error}") from None
    builder = MapBuilder(
        parameters if points is not None else replace(parameters, mode="sequential"),
        surface.frame_id,
        sources=recording.sources,
        reading=recording.options,
        turn=turn_of(surface.meta),
        georeference=where,
        start=surface if points is None else None,
        progress=progress,
        follow=follow,
        jobs=jobs,
        cluster=cluster,
    )
    keeper = PointKeeper()
    keyframes: Iterator[Keyframe] = read(recording, builder.report, progress)
    if points is not None:
        for keyframe in points.keyframes(surface.route):
            builder.add(keyframe)
    if keep_points:
        keyframes = keeper.watch(keyframes)
    feed(builder, recording, progress, keyframes, follows_sights=parameters.map.free_space)
    if points is not None:
        builder.report.points_read += points.read
        builder.report.dropped.update(points.dropped)
    made = builder.finish()
    if not made.size:
        raise InputError(emptied(recording, builder.report))
    kept = None
    if points is not None and keep_points:
        tally = recording.tally
        kept = points.followed_by(keeper.kept(tally.points_read, tally.dropped))
    return Build(replace(made, meta=_meta(earlier, made, parameters)), builder.report, kept)


def _meta(earlier: Earlier, made: SurfaceMap, parameters: Parameters) -> dict[str, Any]:
    """Return the meta of the map of both."""
    before, own = earlier.surface.meta, made.meta
    both = meta_of_both(before, own)
    if earlier.points is not None:
        # The builder has counted both.
        both |= {name: own[name] for name in ("points", "batches")}
    else:
        both["points"] = {**both.get("points", {}), "kept": own["points"]["kept"]}
    told = before.get(ONTO)
    how = BY_POINTS if earlier.points is not None else BY_PATCHES
    steps = [*(told if isinstance(told, list) else []), {"map": earlier.name, "by": how}]
    sizes = before.get("sizes", {})
    return both | {
        "program": own["program"],
        "parameters": to_dict(parameters),
        "reading": _common(before.get("reading"), own["reading"]),
        "sizes": sizes if isinstance(sizes, dict) else {},
        "keyframes": own["keyframes"],
        ONTO: steps,
    }


def _common(one: Any, other: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options on which two readings agree."""
    known = one if isinstance(one, Mapping) else {}
    return {name: value for name, value in other.items() if known.get(name) == value}
