"""Publishers that contradict each other about a frame: two parents by turns, two places by turns.

A frame has one parent (REP 105). Where two nodes publish it in different ones, a map of both would
be neither's, so one is chosen; where two publish it in the same one, nothing tells them apart.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mlscli.geometry.transforms import bare
from mlscli.io.plausibility.publishers import alternate, of_one_body
from mlscli.io.reading.names import WORLD_FRAMES
from mlscli.io.source import StampedPoses
from mlscli.runtime.arrays import Float64

Link = tuple[str, str]
"""A frame's parent, and the frame."""


class Settled(NamedTuple):
    """What is taken of transforms that contradict each other.

    Attributes
    ----------
    others : set of (str, str)
        The links, parent and child, that are not taken.
    notes : list of str
        Which these are, and what would take them.
    faults : dict of str to str
        By frame, why it is not known where it is.
    """

    others: set[Link]
    notes: list[str]
    faults: dict[str, str]


def link_of(poses: StampedPoses) -> Link:
    """Return the parent and the child of poses."""
    return bare(poses.parent), bare(poses.child)


def settle(moving: Sequence[StampedPoses], links: Iterable[Link], declared: str | None) -> Settled:
    """Choose among transforms over time that contradict each other.

    Of several parents that a frame has by turns that is taken which leads to the frame that the
    user names; or else one in which it moves, a world frame, a map rather than odometry, the one
    that is told more often.

    Parameters
    ----------
    moving : sequence of StampedPoses
        In the order of their recording.
    links : iterable of (str, str)
        All parents and children of the recording.
    declared : str or None
        The map frame, if the user names it.
    """
    tables: dict[str, dict[str, list[StampedPoses]]] = defaultdict(lambda: defaultdict(list))
    for poses in moving:
        parent, child = link_of(poses)
        tables[child][parent].append(poses)
    found, known = Settled(set(), [], {}), set(links)
    for child, table in sorted(tables.items()):
        parents = sorted(table)
        if len(parents) > 1 and _by_turns([table[parent] for parent in parents]):
            led = [each for each in parents if declared and _lead(each, declared, known, child)]
            chosen = min(parents, key=lambda each: (each not in led, *_rank(each, table[each])))
            parents.remove(chosen)
            found.others.update((parent, child) for parent in parents)
            found.notes.append(
                f"{child!r} is told in {chosen!r} and {', '.join(map(repr, parents))} by turns, "
                f"and a frame has one parent (REP 105): {chosen!r} is taken, `frame` names another"
            )
            parents = [chosen]
        for parent in parents:
            some = table[parent]
            finding = of_one_body(
                column(some, "stamps"), column(some, "translations"), column(some, "quaternions")
            )
            if finding.value is None:
                found.faults[child] = f"{child!r} in {parent!r} is {finding.refusal}"
    return found


def column(some: Sequence[StampedPoses], name: str) -> Float64:
    """Return an attribute of all poses, (N,) or (N, K)."""
    return np.concatenate([getattr(poses, name) for poses in some])


def _by_turns(tables: Sequence[Sequence[StampedPoses]]) -> bool:
    """Return whether parents, of each of which there are poses, take turns in time."""
    stamps = [column(some, "stamps") for some in tables]
    labels = np.repeat(np.arange(len(stamps)), [len(each) for each in stamps])
    return alternate(labels[np.argsort(np.concatenate(stamps), kind="stable")])


def _lead(frame: str, target: str, links: set[Link], child: str) -> bool:
    """Return whether links lead from a frame to another one, and not by way of a child of it."""
    reached, fresh = {frame}, [frame]
    while fresh:
        here = fresh.pop()
        near = {b for link in links for a, b in (link, link[::-1]) if a == here} - reached - {child}
        reached |= near
        fresh += near
    return target in reached


def _rank(parent: str, told: Sequence[StampedPoses]) -> tuple[bool, int, int, str]:
    """Return what is least for the parent to be chosen."""
    name, last = parent.rpartition("/")[2], len(WORLD_FRAMES)
    order = WORLD_FRAMES.index(name) if name in WORLD_FRAMES else last + 1
    stays = not np.ptp(column(told, "translations"), axis=0).any()
    count = sum(len(poses.stamps) for poses in told)
    return stays, last if name.startswith("odom") else order, -count, parent
