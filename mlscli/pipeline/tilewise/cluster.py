"""Tiles evaluated on more than one machine, by the workers of a Dask cluster.

Each tile is a task of its own: the stages, and the points that it needs. The scheduler keeps it
until its result is here, so that where a worker dies another evaluates its tiles anew. Workers run
the same kernels on the same numbers, and are refused where their versions differ: so the map is
the same, bit for bit.

References
----------
https://distributed.dask.org/en/stable/resilience.html
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from mlscli.errors import ClusterError
from mlscli.keyframes.batches import Points
from mlscli.maps.cells import Limits
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.tiles import EvaluatedTile, Tile, evaluate, points_around
from mlscli.runtime.threads import in_turn
from mlscli.version import __version__

# Seconds in which a cluster without workers may get one, twice over.
PATIENCE_SECONDS = 15

# Seconds until all machines must have told their versions: loading numba takes some.
LOADED = 60

# While a tile is evaluated, the next one is on its way.
AHEAD = 2

# Bytes of memory that it takes here at most to send a point.
SENT = 200


def versions() -> dict[str, str]:
    """Return the versions of what the map's bits depend on."""
    import numba

    return {"mlscli": __version__, "numpy": np.__version__, "numba": numba.__version__}


class Cluster:
    """Workers of a Dask cluster, from `connection.connected`.

    Parameters
    ----------
    name : str
        What messages call it.
    client : distributed.Client

    Attributes
    ----------
    number : int
        How many tiles could be evaluated at a time when it was connected to; at least one.
    """

    def __init__(self, name: str, client: Any) -> None:
        self._name = name
        self._client = client
        self._versions = versions()
        with self._spoken_to():
            # Something to do: a cluster that follows its load starts a worker for it.
            self._failure(client.submit(os.getpid, pure=False))
            # One that has left meanwhile may come back.
            self.number: int = max(1, sum(client.nthreads().values()))
            self._check()

    @property
    def memory_per_point(self) -> int:
        """Bytes that it takes here, at most, for each point of the largest tile."""
        return SENT * AHEAD * self.number

    def evaluate_all(
        self, pipeline: Pipeline, blocks: PointBlocks, tiles: Sequence[Tile]
    ) -> Iterator[EvaluatedTile]:
        """Yield the tiles evaluated, in their order.

        Raises
        ------
        ClusterError
            The scheduler, or all workers, are lost; a tile is too much for several in turn.
        """
        pipeline = pipeline.reporting_to(Report())
        waiting: deque[tuple[Tile, Any]] = deque()
        for tile in tiles:
            points = points_around(pipeline, blocks, tile.limits)
            order = Order(pipeline, points, tile.limits, self._versions)
            with self._spoken_to():
                waiting.append((tile, self._client.submit(carry_out, order, pure=False)))
            if len(waiting) == AHEAD * self.number:
                yield self._result(*waiting.popleft())
        while waiting:
            yield self._result(*waiting.popleft())

    def _result(self, tile: Tile, future: Any) -> EvaluatedTile:
        from distributed.scheduler import KilledWorker

        with self._spoken_to():
            failure = self._failure(future)
            if failure is None:
                result: EvaluatedTile = future.result()
                return result
        match failure:
            case KilledWorker():
                raise ClusterError(
                    f"{self._name}: every worker that was to evaluate a tile of {tile.points:,} "
                    f"points died, {failure.allowed_failures + 1} in turn; give each more memory"
                )
            case ImportError():
                raise ClusterError(
                    f"{self._name}: a worker cannot load mlscli: {first_line(failure)}"
                )
            case _:
                raise failure

    def _failure(self, future: Any) -> BaseException | None:
        """Wait until a task is done, but not for ever where nobody is to do it."""
        while True:
            try:
                failure: BaseException | None = future.exception(timeout=PATIENCE_SECONDS)
            except TimeoutError:
                if not self._client.nthreads():
                    self._wait_for_workers()
            else:
                return failure

    def _wait_for_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE_SECONDS)
        except TimeoutError:
            raise ClusterError(
                f"{self._name}: the cluster has no worker, and got none in "
                f"{2 * PATIENCE_SECONDS} s; start some, such as: dask worker {self._name}"
            ) from None

    def _check(self) -> None:
        """Refuse machines where other versions are installed."""
        found: dict[str, Any] = {}
        try:
            found["the scheduler"] = self._asked(self._client.run_on_scheduler)
        except ClusterError:
            raise
        except Exception as error:
            found["the scheduler"] = error
        workers = self._asked(self._client.run, on_error="return")
        found |= {f"worker {address}": answer for address, answer in workers.items()}
        for who, answer in found.items():
            # One that is gone meanwhile does nothing wrong.
            if isinstance(answer, OSError):
                continue
            if isinstance(answer, Exception):
                raise ClusterError(f"{self._name}: {who} cannot load mlscli: {first_line(answer)}")
            if answer != self._versions:
                raise ClusterError(f"{self._name}: {_differing(who, answer, self._versions)}")

    def _asked(self, run: Callable[..., Any], **options: Any) -> Any:
        """Have machines tell their versions, but not wait for ever for one that hangs."""
        try:
            return run(versions, callback_timeout=LOADED, **options)
        except TimeoutError:
            raise ClusterError(
                f"{self._name}: not all machines told their versions within {LOADED} s"
            ) from None

    @contextmanager
    def _spoken_to(self) -> Iterator[None]:
        """Say in a line that the scheduler is lost."""
        try:
            yield
        except (OSError, CancelledError) as error:
            raise ClusterError(
                f"{self._name}: the connection to the scheduler is lost: {first_line(error)}"
            ) from error


@dataclass(frozen=True)
class Order:
    """A tile to evaluate, as it is sent."""

    pipeline: Pipeline
    points: Points
    limits: Limits
    versions: dict[str, str]


def carry_out(order: Order) -> EvaluatedTile:
    """Evaluate a tile; called by a worker."""
    if versions() != order.versions:
        raise ClusterError(_differing("a worker that joined", versions(), order.versions))
    # What arrives need not lie as the kernels, which are compiled already, have it.
    xyz = np.require(order.points.xyz, requirements=["C", "A", "W"])
    keyframe = np.require(order.points.keyframe, requirements=["C", "A", "W"])
    points = Points(xyz, keyframe)
    call = partial(evaluate, order.pipeline, points, order.limits)
    # Dask has counted the processors: the stages start no threads of their own.
    (result,) = in_turn([call], threads=1)
    return result


def _differing(who: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> str:
    package = next(name for name in wanted if found.get(name) != wanted[name])
    return (
        f"{who} has {package} {found.get(package)}, and here is {wanted[package]}; "
        "install the same version on both"
    )


def first_line(error: BaseException) -> str:
    """Return the first line of what an error of Dask's says."""
    return str(error).partition("\n")[0].strip()
