"""What a long build keeps of its tiles, so that it can go on after it was interrupted.

A checkpoint is a folder beside the map. `build.json` says of which build it is, how that divided
the plane, and a digest of the points. Each other file holds the tiles that were evaluated in an
interval; it ends with a digest of itself, and is there whole or not at all. Since tiles can be
evaluated in any order and by anybody, a file that is damaged costs its tiles alone.

The recording is read anew: what reading finds, notes and drops is not kept.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from mlscli.errors import InputError, OutputError, UsageError, shorten
from mlscli.io.writing.atomic import atomic_write
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import Limits
from mlscli.maps.grid import Grid
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.tile_files import DIGEST, digest_of, is_whole, keep_tiles, tiles_in
from mlscli.pipeline.tilewise.tiles import EvaluatedTile, Tile, Workers
from mlscli.runtime.notices import notice
from mlscli.runtime.temporary import remove_abandoned

_BUILD = "build.json"
_PART = re.compile(r"tiles-(\d{6})")


def folder_of(target: str | os.PathLike[str]) -> Path:
    """Return the folder of the checkpoint of a map that is to be written to `target`."""
    return Path(f"{os.fspath(target)}.checkpoint")


class _Build(NamedTuple):
    """What `build.json` says.

    Attributes
    ----------
    identity : dict
        As for `Checkpoint.begin`.
    points : str
        Digest of the keyframes.
    every : float
        Seconds between checkpoints.
    tiles : list of Tile
    """

    identity: dict[str, Any]
    points: str
    every: float
    tiles: list[Tile]


class Checkpoint:
    """The checkpoint of a build, and what is found of one that was interrupted.

    Within its context, no other program can use it.

    Parameters
    ----------
    target : path
        The map that is to be written.
    every : float, optional
        Seconds after which what was evaluated is kept; by default as in the checkpoint that is
        resumed, and where there is none, never.
    resume : bool
        Whether to go on from what is there.
    overwrite : bool
        Whether what is there may be replaced where it is not resumed.

    Raises
    ------
    UsageError
        Where an interrupted build left a checkpoint, and neither `resume` nor `overwrite` says
        what to do with it.
    InputError
        Where the checkpoint to resume is damaged.
    OutputError
        Where another program writes there.
    """

    def __init__(
        self,
        target: str | os.PathLike[str],
        *,
        every: float | None = None,
        resume: bool = False,
        overwrite: bool = False,
    ) -> None:
        self.folder = folder_of(target)
        self._every, self._resume, self._overwrite = every, resume, overwrite
        self._found: _Build | None = None
        self._lock: int | None = None
        self._digest = hashlib.blake2b(digest_size=DIGEST)
        self._identity: dict[str, Any] = {}

    def __enter__(self) -> Checkpoint:
        try:
            self._look()
        except BaseException:
            self._release()
            raise
        return self

    def _look(self) -> None:
        """Find what is there."""
        if os.path.lexists(self.folder):
            self._hold()
        if self._resume:
            self._found = self._read()
            if self._found is None:
                notice(f"{self.folder}: no checkpoint is there; the build begins anew")
            elif self._every is None:
                self._every = self._found.every
        elif (self.folder / _BUILD).exists() and not self._overwrite:
            raise UsageError(
                f"{self.folder}: is the checkpoint of an interrupted build; add `resume` to go on "
                "from it, or `overwrite` to begin anew"
            )

    def __exit__(self, *_: object) -> None:
        self._release()

    def _release(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def begin(self, identity: Mapping[str, Any]) -> None:
        """Take what the map is made of, before it is read: as JSON can hold it.

        Raises
        ------
        UsageError
            Where the checkpoint to resume is of another build, naming the first difference.
        """
        self._identity = json.loads(json.dumps(identity))
        if self._found is not None:
            for name, here, there in _differences(self._identity, self._found.identity):
                named = name.removeprefix("parameters.").removeprefix("pipeline.")
                raise self._other(f"{named} is {here} here, and {there} in the checkpoint")

    def saw(self, keyframe: Keyframe) -> None:
        """Take a keyframe of the build into account, in its order."""
        points = np.ascontiguousarray(keyframe.points, dtype=np.float64)
        position = (float(each) for each in keyframe.position)
        head = struct.pack(
            "<q4d?", len(points), keyframe.stamp, *position, bool(keyframe.is_ranged)
        )
        self._digest.update(head)
        self._digest.update(points.view(np.uint8).data)

    def tiles(self, divide: Callable[[], list[Tile]]) -> list[Tile]:
        """Return the tiles of the build: those of the checkpoint, or else as `divide` has them.

        Raises
        ------
        UsageError
            Where the points that were read are not those of the checkpoint.
        """
        points = self._digest.hexdigest()
        if self._found is not None:
            if points != self._found.points:
                raise self._other("the sources do not hold the points of the checkpoint any more")
            return self._found.tiles
        tiles = divide()
        if self._every is not None:
            self._begin_anew(_Build(self._identity, points, self._every, tiles))
        return tiles

    def kept(self, workers: Workers) -> Workers:
        """Return workers that evaluate only what is not kept yet, and keep what they evaluate."""
        return _KeepingWorkers(workers, self)

    def clear(self) -> None:
        """Remove the checkpoint, as the build is finished."""
        if self._lock is not None:
            self._remove_files()
            try:
                self.folder.rmdir()
            except OSError:
                notice(f"{self.folder}: stays, as it holds more than a checkpoint")

    def stored(self, grid: Grid) -> Iterator[tuple[int, EvaluatedTile]]:
        """Yield the tiles that were evaluated before the build was interrupted, with numbers."""
        if self._found is None:
            return
        known: set[int] = set()
        for path in self._parts():
            if not is_whole(path, self._id):
                notice(f"{path}: is damaged, or of another build; its tiles are evaluated anew")
                path.unlink()
                continue
            for number, tile in tiles_in(path, grid):
                if number not in known:
                    known.add(number)
                    yield number, tile
        notice(
            f"{self.folder}: {len(known):,} of {len(self._found.tiles):,} tiles were evaluated "
            "before; the build goes on from there"
        )

    def keeping(
        self, tiles: Iterator[tuple[int, EvaluatedTile]]
    ) -> Iterator[tuple[int, EvaluatedTile]]:
        """Yield tiles as they come, and keep them."""
        if self._every is None:
            yield from tiles
            return
        number = max((int(path.name[-6:]) for path in self._parts()), default=0)
        for first in tiles:
            number += 1
            due = monotonic() + self._every
            with keep_tiles(self.folder / f"tiles-{number:06d}", self._id) as put:
                put(*first)
                yield first
                if monotonic() >= due:
                    continue
                for following in tiles:
                    put(*following)
                    yield following
                    if monotonic() >= due:
                        break

    def _other(self, difference: str) -> UsageError:
        return UsageError(
            f"{self.folder}: {difference}; build as before, or leave out `resume` and add "
            "`overwrite` to begin anew"
        )

    def _hold(self) -> None:
        """Keep other programs from writing to the folder."""
        try:
            self._lock = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"{self.folder}: another build writes there; let it end, or name another output"
            ) from None
        except OSError as error:
            raise OutputError(
                f"{self.folder}: no checkpoint can lie there: {error.strerror}"
            ) from error

    def _begin_anew(self, build: _Build) -> None:
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: cannot be made: {error.strerror}") from error
        if self._lock is None:
            self._hold()
        self._remove_files()
        rows = [[*tile.limits, tile.points] for tile in build.tiles]
        content = json.dumps([*build[:-1], rows])
        with atomic_write(self.folder / _BUILD) as stream:
            stream.write(f"{digest_of(content)}\n{content}\n".encode())
        self.__dict__.pop("_id", None)

    def _remove_files(self) -> None:
        """Remove the files of a checkpoint; without the first, the others mean nothing."""
        (self.folder / _BUILD).unlink(missing_ok=True)
        for path in self._parts():
            path.unlink()
        remove_abandoned(self.folder)

    def _read(self) -> _Build | None:
        """Return what an interrupted build has left; None: nothing."""
        path = self.folder / _BUILD
        if not path.exists():
            return None
        try:
            digest, content = path.read_text(encoding="utf-8").splitlines()
            if digest != digest_of(content):
                raise ValueError
            identity, points, every, rows = json.loads(content)
            tiles = [Tile(Limits(*row[:4]), int(row[4])) for row in rows]
            return _Build(dict(identity), str(points), float(every), tiles)
        except (
            OSError,
            ValueError,
            TypeError,
            LookupError,
            ArithmeticError,
            RecursionError,
        ) as error:
            raise InputError(
                f"{path}: is damaged, so that nothing is known of the checkpoint; leave out "
                "`resume` and add `overwrite` to begin anew"
            ) from error

    def _parts(self) -> list[Path]:
        """Return the files of tiles, in their order."""
        if not self.folder.is_dir():
            return []
        return sorted(path for path in self.folder.iterdir() if _PART.fullmatch(path.name))

    @cached_property
    def _id(self) -> bytes:
        """What each file of the checkpoint begins with: a digest of `build.json`."""
        return bytes.fromhex(digest_of((self.folder / _BUILD).read_text(encoding="utf-8")))


class _KeepingWorkers:
    """Workers whose tiles are kept in a checkpoint."""

    def __init__(self, workers: Workers, checkpoint: Checkpoint) -> None:
        self._workers = workers
        self._checkpoint = checkpoint

    @property
    def number(self) -> int:
        """How many tiles are evaluated at a time."""
        return self._workers.number

    @property
    def memory_per_point(self) -> int:
        """Bytes of memory that this machine needs for each point of the largest tile, at most."""
        return self._workers.memory_per_point

    def evaluate_all(
        self, pipeline: Pipeline, blocks: PointBlocks, tiles: Sequence[Tile]
    ) -> Iterator[EvaluatedTile]:
        """Yield the tiles that are kept, and then the others, evaluated, in their order."""
        missing = set(range(len(tiles)))
        for number, tile in self._checkpoint.stored(pipeline.grid):
            missing.discard(number)
            yield tile
        left = sorted(missing)
        evaluated = self._workers.evaluate_all(pipeline, blocks, [tiles[n] for n in left])
        for _, tile in self._checkpoint.keeping(zip(left, evaluated, strict=True)):
            yield tile


def _differences(
    here: Mapping[str, Any], there: Mapping[str, Any], inside: str = ""
) -> Iterator[tuple[str, str, str]]:
    """Yield where mappings differ: a dotted name, and what each holds, in words."""
    for name in [*here, *(name for name in there if name not in here)]:
        mine: Any = here.get(name)
        other: Any = there.get(name)
        if isinstance(mine, dict) and isinstance(other, dict):
            yield from _differences(mine, other, f"{inside}{name}.")
        elif _are_stages(mine) and _are_stages(other) and len(mine) == len(other):
            for stage, its_other in zip(mine, other, strict=True):
                yield from _differences(stage, its_other, f"{inside}{name}.")
        elif mine != other:
            yield f"{inside}{name}", _worded(mine), _worded(other)


def _are_stages(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, dict) for item in value)


def _worded(value: Any) -> str:
    return "not given" if value is None else shorten(json.dumps(value, ensure_ascii=False), 200)
