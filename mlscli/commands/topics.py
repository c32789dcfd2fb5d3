"""What `mls info` reports of recordings with topics: the use of each topic, the tree of frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from mlscli.commands import report
from mlscli.errors import printable, with_options

if TYPE_CHECKING:
    from mlscli.geometry.transforms import TransformTree
    from mlscli.io.messages.topic import TopicSource
    from mlscli.io.source import Topic

# Time to read transforms: enough for an hour of them in a bag without images.
_LOOK_SECONDS = 5.0


def describe(source: TopicSource) -> dict[str, Any]:
    """Return topics and their use, frames, notes and losses of a recording, ready for JSON."""
    from mlscli.io.reading.frames import why_not_mapped
    from mlscli.io.reading.glance import Glance
    from mlscli.io.reading.history import History

    glance = Glance(seconds=_LOOK_SECONDS)
    history = History([glance.of(source)], of_clouds=False)
    tree = history.whole
    told = (*source.notes, *source.first_doubts, *history.notes, *history.faults.values())
    notes = [with_options(note) for note in told]
    if glance.poses_cut:
        notes.append(
            f"frames and what leads to them: by the transforms read in {_LOOK_SECONDS:g} s"
        )
    reasons = map(with_options, why_not_mapped(source, tree))
    return {
        "topics": [
            {
                "name": topic.name,
                "type": topic.type,
                "messages": topic.count,
                "use": _use(topic),
                "frame": topic.frame,
                "map_frame": None if why_not else _map_frame(topic, tree),
                "mappable": not why_not,
                "why_not": why_not,
            }
            for topic, why_not in zip(source.topics(), reasons, strict=True)
        ],
        "frames": [link._asdict() for link in tree.links],
        "notes": notes,
        "lost": list(source.losses),
    }


def _use(topic: Topic) -> str | None:
    """Return what a topic can be used for: clouds, poses, transforms or nothing."""
    from mlscli.io.messages.poses import TRANSFORM_TYPES
    from mlscli.io.messages.registry import CLOUD_TYPES

    if topic.type in CLOUD_TYPES:
        return "clouds"
    if topic.poses:
        return "poses"
    return "transforms" if topic.type in TRANSFORM_TYPES else None


def _map_frame(topic: Topic, tree: TransformTree) -> str:
    """Return the map frame that the clouds of a topic get by default."""
    from mlscli.geometry.transforms import bare
    from mlscli.io.reading.frames import world_above
    from mlscli.io.reading.names import is_world

    frame = bare(topic.frame)
    if not frame or is_world(frame):
        return frame or "map"
    return world_above(tree, frame) or frame


def lines(description: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the report on topics and frames; takes what `describe` returns."""
    topics, frames = description["topics"], description["frames"]
    rows = [
        (
            printable(t["name"]),
            printable(t["type"]) or "no type",
            _count(t["messages"]),
            printable(_good_for(t)),
        )
        for t in topics
    ]
    if rows:
        yield report.table(rows, indent="    ", right=[2])
    if not any(topic["use"] == "clouds" for topic in topics):
        from mlscli.io.messages.registry import MAPPABLE

        yield f"  nothing here can be mapped; what can: {MAPPABLE}"
    if frames:
        yield "  frames, each below the one that it is told in"
        yield from _tree(frames)


def _count(messages: int | None) -> str:
    return "?" if messages is None else f"{messages:,}"


def _good_for(topic: dict[str, Any]) -> str:
    if topic["use"] == "poses":
        return "no clouds; poses, for --pose-topic"
    if topic["use"] == "transforms":
        return "no clouds; transforms"
    if topic["use"] is None:
        return "no clouds"
    if not topic["mappable"]:
        return f"not mapped as it is: {topic['why_not']}"
    from mlscli.geometry.transforms import bare

    frame, into = bare(topic["frame"]), topic["map_frame"]
    if not frame:
        return "can be mapped: in no frame"
    moved = f", moved into {into!r} by the transforms" if into != frame else ""
    return f"can be mapped: in {frame!r}{moved}"


def _tree(links: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each frame, below its parent; last, those whose parents form a circle."""
    children = {link["child"] for link in links}
    drawn: set[str] = set()

    def draw(root: str) -> Iterator[str]:
        # No recursion: a chain of frames can be as long as a message allows.
        waiting = [(root, 0, False)]
        while waiting:
            frame, depth, moves = waiting.pop()
            if frame in drawn:
                continue
            drawn.add(frame)
            yield f"    {'  ' * depth}{printable(frame)}{' (moves)' if moves else ''}"
            below = [
                (link["child"], depth + 1, link["moves"])
                for link in links
                if link["parent"] == frame
            ]
            waiting += below[::-1]

    for link in links:
        if link["parent"] not in children and link["parent"] not in drawn:
            yield from draw(link["parent"])
    for link in links:
        if link["child"] not in drawn:
            yield f"    {printable(link['child'])} below {printable(link['parent'])}, in a circle"
