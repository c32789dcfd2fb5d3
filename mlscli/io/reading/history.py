"""What the transforms of a recording said, in the order in which they were recorded.

Where the clock begins anew, an epoch ends: poses of one never serve clouds of another (`epochs`).
A static transform counts from its stamp on. Of several robots' transforms those are taken that
belong to the clouds (`namespaces`). Sources are one recording in the order of the times at which
they were recorded, unless they tell of the same frames at the same times and contradict each other:
then each has transforms of its own.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mlscli.geometry.transforms import TransformTree, bare
from mlscli.io.plausibility.epochs import Epochs, told
from mlscli.io.reading.namespaces import choose
from mlscli.io.reading.rivals import Settled, column, link_of, settle
from mlscli.io.source import Source, StampedPoses
from mlscli.runtime.arrays import Float64

# The stamp of a static transform is none of the clock's if it is farther off (s).
_FARTHEST = 3600.0


class Moment(NamedTuple):
    """When a cloud was taken.

    Attributes
    ----------
    stamp, logged : float
        As its header says, and when it was recorded, in seconds; NaN where not known.
    source : Source or None
        Where it was recorded.
    """

    stamp: float
    logged: float = math.nan
    source: Source | None = None


class History:
    """The transforms of sources.

    Attributes
    ----------
    whole : TransformTree
        All of them, to see how frames hang together.
    notes : list of str
        What the user should know about how they are taken.
    contradiction : str
        Why it is not known whose transforms are those of the clouds; empty where it is.
    faults : dict of str to str
        By frame, why its transforms say nothing: they contradict each other (`rivals`).
    times : float64 (M, 2)
        The stamps of transforms over time, and when they were recorded.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        gap: float | None = None,
        frame: str | None = None,
        *,
        of_clouds: bool = True,
    ) -> None:
        """Read the transforms of sources.

        Parameters
        ----------
        sources : sequence of Source
        gap : float, optional
            Nothing is interpolated across so many seconds, see `PoseTrack`.
        frame : str, optional
            The map frame, if the user names it.
        of_clouds : bool
            Whether to take only those that belong to the topic of the clouds.
        """
        self.notes: list[str] = []
        self.contradiction = ""
        self.faults: dict[str, str] = {}
        self.times = np.empty((0, 2))
        self._gap, self._frame = gap, frame
        read = [list(source.transforms()) for source in sources]
        if of_clouds:
            read = [self._own(each, source) for each, source in zip(read, sources, strict=True)]
        groups = [list(range(len(sources)))]
        if _contradict(read):
            groups = [[number] for number, each in enumerate(read) if each]
            self.notes.append(
                "several sources tell of the same frames at the same times; the clouds of each are "
                "moved by its own transforms"
            )
        self._others: set[tuple[str, str]] = set()
        self._groups = {
            id(sources[number]): place for place, group in enumerate(groups) for number in group
        }
        self._told = [self._group(read, group) for group in groups]
        if not of_clouds:
            self._tell_robots(read)
        trees = [tree for _, some in self._told for tree in some]
        self.whole = trees[0] if len(trees) == 1 else TransformTree(gap)
        if len(trees) > 1:
            taken = [each for some in read for each in some if link_of(each[0]) not in self._others]
            _add_moving(self.whole, [poses for poses, stays in taken if not stays])
            for poses in (poses for poses, stays in taken if stays):
                _add_static(self.whole, poses)

    def at(self, moment: Moment) -> TransformTree:
        """Return the transforms in force for a cloud; none where it is not known which."""
        group = self._groups.get(id(moment.source)) if len(self._told) > 1 else 0
        if group is None:
            return TransformTree(self._gap)
        epochs, trees = self._told[group]
        return trees[epochs.at(moment.stamp, moment.logged)]

    def trees(self) -> Iterator[TransformTree]:
        """Yield the trees of all epochs, each once."""
        for _, trees in self._told:
            yield from trees

    def add_static(self, parent: str, child: str, translation: Float64, rotation: Float64) -> None:
        """Add T_parent_child, which stays at all times, as in `TransformTree`."""
        for tree in dict.fromkeys((self.whole, *self.trees())):
            tree.add_static(parent, child, translation, rotation)

    def _take(self, settled: Settled) -> None:
        """Note what was chosen among transforms that contradict each other."""
        self._others |= settled.others
        self.faults |= settled.faults
        self.notes += [note for note in settled.notes if note not in self.notes]

    def _tell_robots(self, read: Sequence[list[tuple[StampedPoses, bool]]]) -> None:
        """Where several name spaces tell of one frame, say that, and not what they contradict."""
        rivals = {
            topic for each in read for topic in choose((poses for poses, _ in each), "").children
        }
        if rivals:
            self.faults = {}
            self.notes = [
                "transforms of several name spaces tell of the same frames, "
                f"{', '.join(sorted(rivals))} among them; those count whose name space holds the "
                "topic of the clouds"
            ]

    def _own(
        self, read: list[tuple[StampedPoses, bool]], source: Source
    ) -> list[tuple[StampedPoses, bool]]:
        """Return the transforms of a source that are those of its clouds."""
        topics = {poses.topic for poses, _ in read}
        if len({topic.rpartition("/")[0] for topic in topics}) < 2:
            return read
        choice = choose((poses for poses, _ in read), source.topic)
        if choice.note:
            self.notes.append(f"{source.path}: {choice.note}")
        if choice.is_open:
            self.contradiction = choice.note
        return [
            (poses, stays)
            for poses, stays in read
            if bare(poses.child) not in choice.children.get(poses.topic, ())
        ]

    def _group(
        self, read: Sequence[list[tuple[StampedPoses, bool]]], group: Sequence[int]
    ) -> tuple[Epochs, list[TransformTree]]:
        """Return the epochs of sources that are one recording, and the transforms of each."""
        own = [each for number in group for each in read[number] if len(each[0].stamps)]
        own.sort(key=lambda each: each[0].logged)
        moving = [poses for poses, stays in own if not stays]
        streams: dict[Hashable, list[int]] = {}
        for number, poses in enumerate(moving):
            streams.setdefault(_stream(poses), []).append(number)
        logged = np.array([poses.logged for poses in moving])
        stamps = _latest(moving)
        self.times = np.concatenate((self.times, np.column_stack((stamps, logged))))
        epochs = Epochs.of({key: (logged[rows], stamps[rows]) for key, rows in streams.items()})
        if jumps := [(begin.before, begin.after) for begin in epochs.begins]:
            self.notes.append(
                f"the clock of the transforms jumps back {told(jumps)}; clouds are moved by those "
                "that were recorded since the last jump before them"
            )
        trees = [TransformTree(self._gap) for _ in range(len(epochs.begins) + 1)]
        # What other sources state for all times serves where a source does not.
        for number, each in enumerate(read):
            if number not in group:
                for poses, stays in each:
                    for tree in trees if stays else ():
                        _add_static(tree, poses)
        place = np.zeros((len(moving), 2), dtype=np.int64)
        for key, runs in epochs.runs.items():
            for first, stop, begin, last in runs:
                place[streams[key][first:stop]] = begin, last
        links = {link_of(poses) for each in read for poses, _ in each}
        of_epochs: list[list[StampedPoses]] = [[] for _ in trees]
        for poses, (begin, last) in zip(moving, place.tolist(), strict=True):
            for some in of_epochs[begin : last + 1]:
                some.append(poses)
        for tree, some in zip(trees, of_epochs, strict=True):
            settled = settle(some, links, self._frame)
            self._take(settled)
            _add_moving(tree, [each for each in some if link_of(each) not in settled.others])
        for child, parents in sorted(
            {k: v for tree in trees for k, v in tree.in_turn().items()}.items()
        ):
            self.notes.append(
                f"{child!r} is told in several frames in turn, {', '.join(map(repr, parents))}; a "
                "frame has one parent (REP 105), and clouds go by the last before them"
            )
        static = [poses for poses, stays in own if stays]
        # The stamps of static transforms are often 0; in turn are those that are recorded so.
        ordered = [
            poses._replace(stamps=np.full(len(poses.stamps), poses.logged)) for poses in static
        ]
        settled = settle(ordered, links, self._frame)
        self._take(settled)
        static = [poses for poses in static if link_of(poses) not in settled.others]
        self._add_static(trees, epochs, static, logged, stamps)
        return epochs, trees

    def _add_static(
        self,
        trees: Sequence[TransformTree],
        epochs: Epochs,
        static: Sequence[StampedPoses],
        logged: Float64,
        stamps: Float64,
    ) -> None:
        """Add static transforms, each from its stamp on; in the epochs after its own, throughout.

        A stamp that cannot be one of the clock, or is none after that of the transform before, as
        of publishers that leave it 0, is replaced by what the clock said at the time of recording.
        """
        latest: dict[str, float] = {}
        changes: dict[str, list[float]] = {}
        for poses in static:
            for row in range(len(poses.stamps)):
                stamp, child = float(poses.stamps[row]), poses.child
                seen = bisect_right(logged, poses.logged)
                clock = float(stamps[seen - 1]) if seen else math.nan
                begin = stamp
                if stamp <= latest.get(child, -math.inf) or abs(stamp - clock) > _FARTHEST:
                    begin = clock
                    if math.isnan(clock):
                        # What comes before all that moves counts from the beginning on.
                        begin = -math.inf if len(stamps) else poses.logged
                latest[child] = max(stamp, latest.get(child, -math.inf))
                epoch = sum(each.logged <= poses.logged for each in epochs.begins)
                is_other = False
                for number, tree in enumerate(trees[epoch:]):
                    is_other |= tree.add_static(
                        poses.parent,
                        child,
                        poses.translations[row],
                        poses.quaternions[row],
                        -math.inf if number else begin,
                    )
                if is_other:
                    changes.setdefault(child, []).append(begin)
        for child, times in changes.items():
            often = f" {len(times):,} times, first" if len(times) > 1 else ""
            when = f"at {times[0]:.3f} s" if math.isfinite(times[0]) else "at the beginning"
            self.notes.append(
                f"the static transform of {child!r} changes{often} {when}; each counts from then on"
            )


def _add_static(tree: TransformTree, poses: StampedPoses) -> None:
    for translation, rotation in zip(poses.translations, poses.quaternions, strict=True):
        tree.add_static(poses.parent, poses.child, translation, rotation)


def _add_moving(tree: TransformTree, told: Iterable[StampedPoses]) -> None:
    """Add transforms over time; of a frame those together that are told in one parent, in order."""
    runs: dict[str, list[StampedPoses]] = {}
    ended = []
    for poses in told:
        run = runs.get(poses.child)
        if run is None or run[0].parent != poses.parent:
            run = runs[poses.child] = []
            ended.append(run)
        run.append(poses)
    for run in ended:
        tree.add(
            run[0].parent,
            run[0].child,
            column(run, "stamps"),
            column(run, "translations"),
            column(run, "quaternions"),
        )


def _latest(moving: Sequence[StampedPoses]) -> Float64:
    """Return the latest stamp of each, (N,); none of them is empty."""
    if not moving:
        return np.empty(0)
    begins = np.cumsum([0, *(len(poses.stamps) for poses in moving[:-1])])
    return np.maximum.reduceat(column(moving, "stamps"), begins)


def _stream(poses: StampedPoses) -> tuple[str, str, str]:
    return poses.topic, poses.parent, poses.child


def _contradict(read: Sequence[list[tuple[StampedPoses, bool]]]) -> bool:
    """Return whether two sources, recorded at the same times, tell a frame's poses differently."""
    if sum(any(not stays for _, stays in each) for each in read) < 2:
        return False
    tables: list[dict[tuple[str, str], Float64]] = []
    for each in read:
        rows: dict[tuple[str, str], list[Float64]] = {}
        for poses, stays in each:
            if not stays and len(poses.stamps):
                logged = np.full(len(poses.stamps), poses.logged)
                row = np.column_stack((poses.stamps, logged, poses.translations))
                rows.setdefault((poses.parent, poses.child), []).append(row)
        tables.append({key: np.concatenate(some) for key, some in rows.items()})
    return any(
        _differ(tables[a][key], tables[b][key])
        for a in range(len(tables))
        for b in range(a)
        for key in tables[a].keys() & tables[b].keys()
    )


def _differ(one: Float64, other: Float64) -> bool:
    """Return whether rows (stamp, logged, x, y, z) of the same times have few poses in common."""
    for axis in (0, 1):
        low = max(one[:, axis].min(), other[:, axis].min())
        high = min(one[:, axis].max(), other[:, axis].max())
        if not low < high:
            return False
        one = one[(one[:, axis] >= low) & (one[:, axis] <= high)]
        other = other[(other[:, axis] >= low) & (other[:, axis] <= high)]
        if not len(one) or not len(other):
            return False
    here = {row.tobytes() for row in one[:, [0, 2, 3, 4]]}
    there = {row.tobytes() for row in other[:, [0, 2, 3, 4]]}
    return len(here & there) * 2 < min(len(here), len(there))
