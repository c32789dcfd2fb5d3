"""Transforms of several robots in one recording, told apart by the name spaces of their topics.

Robots that have frames of the same names publish on topics of their own, /robot1/tf and /robot2/tf.
The name space of the clouds' topic says whose transforms are theirs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

from mlscli.geometry.transforms import bare
from mlscli.io.source import StampedPoses


class Choice(NamedTuple):
    """Which transforms are those of a topic of clouds.

    Attributes
    ----------
    children : dict of str to set of str
        The frames that are not taken, by the topic of their transforms.
    note : str
        What is not taken; empty where all is.
    is_open : bool
        Whether none of the topics that tell of one frame is in a name space of the clouds'.
    """

    children: dict[str, set[str]]
    note: str = ""
    is_open: bool = False


def choose(transforms: Iterable[StampedPoses], topic: str) -> Choice:
    """Choose the transforms for a topic of clouds.

    All are taken unless topics of different name spaces tell of the same frame. Then the one
    counts whose name space holds the topic of the clouds; of several, the innermost.

    Parameters
    ----------
    transforms : iterable of StampedPoses
    topic : str
        The topic of the clouds.
    """
    tellers: dict[str, set[str]] = defaultdict(set)
    for poses in transforms:
        tellers[bare(poses.child)].add(poses.topic)
    spaces = {told: _space(told) for told in set().union(*tellers.values())}
    held = {told: space for told, space in spaces.items() if _holds(space, topic)}
    rivals, ousted, is_open = set[str](), defaultdict[str, set[str]](set), False
    for child, tell in tellers.items():
        if len({spaces[each] for each in tell}) < 2:
            continue
        inner = max((held[each] for each in tell if each in held), key=len, default=None)
        is_open |= inner is None
        rivals |= {each for each in tell if each not in held}
        for each in tell:
            if each in held and held[each] != inner:
                ousted[each].add(child)
    # All of another robot's, as one frame of it would lead to others.
    foreign = {spaces[each] for each in rivals}
    for told, space in spaces.items():
        if space in foreign:
            ousted[told] |= {child for child, by in tellers.items() if told in by}
    if not ousted:
        return Choice({})
    whose = f"the name space of {topic} decides"
    if is_open:
        whose = f"{topic} is in the name space of none of them"
    listed = ", ".join(sorted(ousted))
    return Choice(
        dict(ousted),
        f"several topics of transforms tell of the same frames; not taken: {listed}: {whose}",
        is_open,
    )


def _space(topic: str) -> str:
    return topic.strip("/").rpartition("/")[0]


def _holds(space: str, topic: str) -> bool:
    return not space or topic.strip("/").startswith(f"{space}/")
