"""Tiles evaluated on more than one machine, by the workers of a Dask cluster.

Each tile is one task: the stages, and the points that the tile needs. The scheduler keeps the task
until its result has arrived, so that another worker can evaluate the tile if the first one dies.
Workers run the same kernels on the same numbers, and are refused if their versions differ: the map
is the same, bit for bit.

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

# How long (s) to wait for a task, and then, where there is no worker, for one.
PATIENCE_SECONDS = 15

# How long (s) machines may take to report their versions: loading numba takes some of it.
LOADED = 60

# Tiles sent for each thread of a worker: while one is evaluated, the next is on its way.
AHEAD = 2

# Bytes of memory that sending a point takes on this machine, at most.
SENT = 200


def versions() -> dict[str, str]:
    """Return the versions of the packages on which the bits of the map depend."""
    import numba

    return {"mlscli": __version__, "numpy": np.__version__, "numba": numba.__version__}


class Cluster:
    """Workers of a Dask cluster, from `connection.connected`.

    Parameters
    ----------
    name : str
        The name of the cluster in messages.
    client : distributed.Client

    Attributes
    ----------
    number : int
        How many tiles could be evaluated at a time when the connection was made; at least 1.

    Raises
    ------
    ClusterError
        Where the cluster gets no worker, or its versions differ from those here.
    """

    def __init__(self, name: str, client: Any) -> None:
        self._name = name
        self._client = client
        self._versions = versions()
        with self._spoken_to():
            # Some task, for which a cluster that adapts to its load starts a worker.
            self._failure(client.submit(os.getpid, pure=False))
            # Where all workers have left meanwhile, one may come back.
            self.number: int = max(1, sum(client.nthreads().values()))
            self._check()

    @property
    def memory_per_point(self) -> int:
        """Bytes of memory that this machine needs for each point of the largest tile, at most."""
        return SENT * AHEAD * self.number

    def evaluate_all(
        self, pipeline: Pipeline, blocks: PointBlocks, tiles: Sequence[Tile]
    ) -> Iterator[EvaluatedTile]:
        """Evaluate tiles, and yield the results in their order.

        Raises
        ------
        ClusterError
            Where the scheduler or all workers are lost, or several workers in turn have died of a
            tile.
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
        """Wait until a task is done, and return its error, if any; give up if no worker comes."""
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
        """Refuse machines on which other versions are installed."""
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
            # A worker that has left meanwhile does no harm.
            if isinstance(answer, OSError):
                continue
            if isinstance(answer, Exception):
                raise ClusterError(f"{self._name}: {who} cannot load mlscli: {first_line(answer)}")
            if answer != self._versions:
                raise ClusterError(f"{self._name}: {_differing(who, answer, self._versions)}")

    def _asked(self, run: Callable[..., Any], **options: Any) -> Any:
        """Ask machines for their versions; do not wait for ever for one that hangs."""
        try:
            return run(versions, callback_timeout=LOADED, **options)
        except TimeoutError:
            raise ClusterError(
                f"{self._name}: not all machines told their versions within {LOADED} s"
            ) from None

    @contextmanager
    def _spoken_to(self) -> Iterator[None]:
        """Turn a lost connection into an error of one line."""
        try:
            yield
        except (OSError, CancelledError) as error:
            raise ClusterError(
                f"{self._name}: the connection to the scheduler is lost: {first_line(error)}"
            ) from error


@dataclass(frozen=True)
class Order:
    """A tile to evaluate, as it is sent to a worker.

    Attributes
    ----------
    pipeline : Pipeline
    points : Points
        From `points_around`.
    limits : Limits
        The cells of the tile.
    versions : dict of str
        The versions that the worker must have, by package.
    """

    pipeline: Pipeline
    points: Points
    limits: Limits
    versions: dict[str, str]


def carry_out(order: Order) -> EvaluatedTile:
    """Evaluate a tile; called by a worker.

    Raises
    ------
    ClusterError
        Where its versions differ from those of the order.
    """
    if versions() != order.versions:
        raise ClusterError(_differing("a worker that joined", versions(), order.versions))
    # Arrays may arrive in a memory layout for which the kernels are not compiled yet.
    points = Points._make(np.require(part, requirements=["C", "A", "W"]) for part in order.points)
    call = partial(evaluate, order.pipeline, points, order.limits)
    # Dask keeps all processors busy: the stages start no threads of their own.
    (result,) = in_turn([call], threads=1)
    return result


def _differing(who: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> str:
    package = next(name for name in wanted if found.get(name) != wanted[name])
    return (
        f"{who} has {package} {found.get(package)}, and here is {wanted[package]}; "
        "install the same version on both"
    )


def first_line(error: BaseException) -> str:
    """Return the first line of the message of an error."""
    return str(error).partition("\n")[0].strip()
