"""Tiles evaluated by a Dask cluster: the same map, also where workers die.

How one could cheat: one tile; one worker; a map in which nothing reaches over the edge of a tile;
tiles that are evaluated here after all; a worker that dies when it has nothing to do.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import dask
import numpy as np
import psutil
import pytest
from distributed import Client, LocalCluster

import mlscli
from mlscli.building import large
from mlscli.building.build import build
from mlscli.building.builder import MapBuilder
from mlscli.building.large import build_large
from mlscli.errors import ClusterError, UsageError
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import write_map
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import Limits
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise import cluster, connection
from mlscli.pipeline.tilewise import tiles as tilewise
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.cluster import AHEAD, Cluster, Order, carry_out, versions
from mlscli.pipeline.tilewise.connection import connected
from mlscli.pipeline.tilewise.tiles import Threads, evaluate_tiles, join, tiles_of
from tests.helpers.killed import MOMENT
from tests.helpers.maps import CELL, random_points
from tests.helpers.program import heed_interrupts, mls
from tests.helpers.stages import Fatal, Hooked
from tests.pipeline.test_growing import PIPELINES, one_pass, parameters

SAMPLE = Path(__file__).resolve().parents[3] / "data/samples/bridge.txt"
SET = ("--set", "map.cell_size=0.5")
SAMPLED = mlscli.load_parameters(None, [SET[1]])
GIVEN = parameters(PIPELINES["every stage"])


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Return a Dask cluster of two processes."""
    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",
        local_directory=str(tmp_path_factory.mktemp("dask")),
        silence_logs=50,
    ) as made:
        yield made


@pytest.fixture
def address(running: Any) -> str:
    """Return the address of its scheduler."""
    running.wait_for_workers(1, timeout=60)
    return str(running.scheduler_address)


@pytest.fixture
def workers(address: str) -> Iterator[Cluster]:
    with connected(address) as made:
        yield made


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the map's file that one pass makes of the sample."""
    path = tmp_path_factory.mktemp("expected") / "map.npz"
    write_map(path, build(open_recording(SAMPLE), SAMPLED).surface)
    return path


def levels() -> Points:
    return random_points(np.random.default_rng(11), 3000)


def blocks_of(points: Points) -> PointBlocks:
    blocks = PointBlocks(CELL, shift=0)
    blocks.add(points)
    return blocks


def test_a_cluster_makes_the_map_of_one_pass(
    monkeypatch: pytest.MonkeyPatch, workers: Cluster
) -> None:
    monkeypatch.setattr(tilewise, "WORTHWHILE_POINTS", 1)
    told: list[tuple[str, int, int | None]] = []
    given = parameters(PIPELINES["regions last"])
    surfaces = []
    for hands in (None, workers):
        builder = MapBuilder(given, cluster=hands, progress=lambda *now: told.append(now))
        builder.add(Keyframe(levels().xyz))
        surfaces.append((builder.finish(), builder.report.dropped))
    (expected, dropped), (surface, dropped_there) = surfaces
    assert surface == expected
    assert surface.meta == expected.meta
    assert dropped_there == dropped
    tiles = [(done, of) for what, done, of in told if what == "tiles"]
    assert tiles == [(n + 1, len(tiles)) for n in range(len(tiles))]
    assert len(tiles) > 2


def test_a_cluster_makes_the_free_space_of_one_pass(
    monkeypatch: pytest.MonkeyPatch, workers: Cluster
) -> None:
    monkeypatch.setattr(tilewise, "WORTHWHILE_POINTS", 1)
    given = parameters(PIPELINES["regions last"]).with_free_space()
    surfaces = []
    for hands in (None, workers):
        builder = MapBuilder(given, cluster=hands)
        for number, part in enumerate(np.array_split(levels().xyz, 4)):
            builder.add(Keyframe(part, position=(1.3 * number, 0.7, 6.1)))
        surfaces.append(builder.finish())
    expected, surface = surfaces
    assert expected.free is not None
    assert expected.free.lines.max() > 1
    assert surface == expected
    assert surface.free == expected.free


def test_tiles_come_in_their_order_and_few_are_on_their_way(workers: Cluster) -> None:
    taken = []

    class Watched(PointBlocks):
        def extract(self, limits: Limits) -> Points:
            taken.append(limits)
            return super().extract(limits)

    blocks = Watched(CELL, shift=0)
    blocks.add(levels())
    pipeline = Pipeline(GIVEN, "map", Report())
    tiles = tiles_of(blocks, pipeline.reach, 0)
    assert workers.number == 2
    assert len(tiles) > 30
    here = list(Threads(1).evaluate_all(pipeline, blocks, tiles))
    taken.clear()
    for number, (there, expected) in enumerate(
        zip(workers.evaluate_all(pipeline, blocks, tiles), here, strict=True), 1
    ):
        assert there.surface == expected.surface
        assert there.report.dropped == expected.report.dropped
        assert len(taken) < number + 2 * AHEAD
    assert len(taken) == len(tiles)


def test_the_program_writes_the_same_file(address: str, expected: Path, tmp_path: Path) -> None:
    done = mls("build", SAMPLE, *SET, "-o", "there.npz", "--scheduler", address, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert (tmp_path / "there.npz").read_bytes() == expected.read_bytes()


def test_a_cloud_larger_than_memory_goes_to_a_cluster_tile_by_tile(
    monkeypatch: pytest.MonkeyPatch, address: str, expected: Path, tmp_path: Path
) -> None:
    monkeypatch.setattr(large, "COMFORTABLE_POINTS", 1500)
    recording = open_recording(SAMPLE)
    with build_large(recording, SAMPLED, 2**31, scratch=tmp_path, scheduler=address) as made:
        write_map(tmp_path / "large.npz", made.surface)
    assert (tmp_path / "large.npz").read_bytes() == expected.read_bytes()


def test_a_cluster_of_ones_own_leaves_nothing_but_the_map(expected: Path, tmp_path: Path) -> None:
    for name in ("home", "temporary", "work"):
        (tmp_path / name).mkdir()
    environment = {"HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "temporary")}
    done = mls(
        "build", SAMPLE, *SET, "--scheduler", "local", cwd=tmp_path / "work", env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    left = sorted(path.name for path in tmp_path.rglob("*"))
    assert left == ["bridge.npz", "home", "temporary", "work"]
    assert (tmp_path / "work/bridge.npz").read_bytes() == expected.read_bytes()


def test_an_interrupt_ends_workers_and_program_in_a_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mlscli", "build", str(SAMPLE), "--scheduler", "local"]
    program = subprocess.Popen(
        command,
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )
    started: list[psutil.Process] = []
    # One of them keeps account of what the others share.
    while len(started) < 2 and program.poll() is None:
        time.sleep(0.02)
        started = psutil.Process(program.pid).children(recursive=True)
    # As a terminal does: to all of them.
    os.killpg(program.pid, signal.SIGINT)
    _, errors = program.communicate(timeout=60)
    assert program.returncode == 130
    assert errors.splitlines()[-1] == "mls: interrupted"
    assert "Traceback" not in errors
    assert psutil.wait_procs(started, timeout=10)[1] == []
    assert list(tmp_path.iterdir()) == []


def test_a_scheduler_lost_at_work_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    hooked = replace(GIVEN, pipeline=(Hooked(), *GIVEN.pipeline))
    pipeline = Pipeline(hooked, "map", Report())
    blocks = blocks_of(levels())
    with (
        # So long does the test's own cluster look for the scheduler when it closes.
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        LocalCluster(n_workers=1, processes=False, dashboard_address="127.0.0.1:0") as brief,
        Client(brief, set_as_default=False) as client,
    ):
        workers = Cluster("tcp://brief:1", client)
        close = partial(brief.loop.add_callback, brief.scheduler.close)
        monkeypatch.setattr("tests.helpers.stages.called", [close])
        with pytest.raises(ClusterError, match=r"tcp://brief:1: the connection .* is lost: "):
            list(workers.evaluate_all(pipeline, blocks, tiles_of(blocks, pipeline.reach, 400)))


# --- what is refused ---


@pytest.mark.parametrize(
    "words",
    ["", "here", "10.0.0.1", "tcp://10.0.0.1", "http://h:1", "tcp://h:99999", "tcp://a b:1"],
)
def test_an_address_that_is_none_is_wrong_usage(words: str) -> None:
    with (
        pytest.raises(UsageError, match=r"`scheduler` .*: is no address; write tcp://host:port"),
        connected(words),
    ):
        pass


def test_without_dask_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    told = r"`scheduler`: .*pip install 'mlscli\[dask\]'"
    with pytest.raises(UsageError, match=told), connected("local"):
        pass


def test_where_no_scheduler_answers_it_says_so_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "ANSWER", 0.5)
    begin = time.monotonic()
    with socket.create_server(("127.0.0.1", 0)) as mute:
        for port in (9, mute.getsockname()[1]):
            told = f"`scheduler` tcp://127.0.0.1:{port}: no scheduler answers there: "
            with (
                pytest.raises(ClusterError, match=told) as error,
                connected(f"tcp://127.0.0.1:{port}"),
            ):
                pass
            assert "\n" not in str(error.value)
    assert time.monotonic() - begin < 10


def test_a_cluster_without_workers_is_not_waited_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "PATIENCE_SECONDS", 0.2)
    told = "the cluster has no worker"
    with (
        LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", silence_logs=50) as empty,
        pytest.raises(ClusterError, match=told),
        connected(empty.scheduler_address),
    ):
        pass


def test_a_cluster_whose_last_worker_has_just_left_is_one_that_may_get_another() -> None:
    class Left:
        """Speaks as a client whose worker did what it was asked first, and went."""

        def submit(self, *_: object, **options: object) -> Left:  # noqa: ARG002
            return self

        def exception(self, timeout: float) -> None:
            """Tell of no failure."""

        def nthreads(self) -> dict[str, int]:
            return {}

        def run_on_scheduler(self, call: Any, **options: object) -> object:  # noqa: ARG002
            return call()

        def run(self, *_: object, **options: object) -> dict[str, object]:  # noqa: ARG002
            return {}

    assert Cluster("tcp://left:1", Left()).number == 1


def test_a_worker_with_another_version_is_refused(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    found = versions()["numba"]
    monkeypatch.setattr("numba.__version__", "0.1")
    told = rf"worker tcp://\S+ has numba {found}, and here is 0\.1; install the same"
    with pytest.raises(ClusterError, match=told), connected(address):
        pass


def test_a_worker_that_joins_later_is_looked_at_too() -> None:
    pipeline = Pipeline(GIVEN, "map", Report())
    order = Order(pipeline, gather([]).points, Limits(), {**versions(), "numpy": "1.0"})
    with pytest.raises(ClusterError, match=r"a worker that joined has numpy .*, and here is 1\.0"):
        carry_out(order)


def test_a_worker_without_the_program_is_refused(address: str) -> None:
    module = "mlscli.pipeline.tilewise.cluster"
    with Client(address, set_as_default=False) as client:
        client.run(exec, f"import sys; sys.modules[{module!r}] = None")
        try:
            with (
                pytest.raises(ClusterError, match=r"worker tcp://\S+ cannot load mlscli"),
                connected(address),
            ):
                pass
        finally:
            client.run(exec, f"import sys; del sys.modules[{module!r}]")


def test_a_worker_that_does_not_answer_is_not_waited_for_long(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr(cluster, "LOADED", 0.5)
    module = "mlscli.pipeline.tilewise.cluster"
    with Client(address, set_as_default=False) as client:
        # As one that hangs, but not for ever.
        hang = "async def versions(): import asyncio; await asyncio.sleep(20)"
        client.run(exec, f"import {module} as m; m.told = m.versions; exec({hang!r}, vars(m))")
        begin = time.monotonic()
        try:
            with (
                pytest.raises(ClusterError, match="not all machines told their versions within"),
                connected(address),
            ):
                pass
        finally:
            client.run(exec, f"import {module} as m; m.versions = m.told")
        assert time.monotonic() - begin < 10


# --- workers that die: the last tests, as no more of them need be left than one ---


def test_a_worker_killed_at_its_work_loses_nothing(workers: Cluster, tmp_path: Path) -> None:
    (tmp_path / "life").touch()
    fatal = replace(GIVEN, pipeline=(Fatal(str(tmp_path)), *GIVEN.pipeline))
    pipeline = Pipeline(fatal, "map", Report())
    blocks = blocks_of(levels())
    tiles = tiles_of(blocks, pipeline.reach, 400)
    surface = join(pipeline.grid, list(evaluate_tiles(pipeline, blocks, tiles, workers)))
    assert list(tmp_path.iterdir()) == []
    assert surface == one_pass(levels(), GIVEN, final=False)


def test_a_tile_that_kills_every_worker_is_told(
    monkeypatch: pytest.MonkeyPatch, running: Any, workers: Cluster, tmp_path: Path
) -> None:
    monkeypatch.setattr(running.scheduler, "allowed_failures", 0)
    (tmp_path / "life").touch()
    fatal = replace(GIVEN, pipeline=(Fatal(str(tmp_path)), *GIVEN.pipeline))
    pipeline = Pipeline(fatal, "map", Report())
    blocks = blocks_of(levels())
    (tile,) = tiles_of(blocks, pipeline.reach, 10**9)
    with pytest.raises(ClusterError, match="a tile of 3,000 points died, 1 in turn; give each"):
        list(workers.evaluate_all(pipeline, blocks, [tile]))


def test_a_build_killed_on_a_cluster_goes_on_there_to_the_same_map(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = np.random.default_rng(5).uniform((0, 0, 0), (90, 7, 0.2), (2000, 3))
    np.savetxt(tmp_path / "flight.txt", places, fmt="%.5f")
    one = ("build", "flight.txt", "-c", "plain", "--set", "map.cell_size=0.5")
    assert mls(*one, "-o", "whole.npz", cwd=tmp_path).returncode == 0
    there = (*one, "--scheduler", address, "-o", "map.npz")
    monkeypatch.setenv(MOMENT, "60")

    killed = mls(*there, "--checkpoint-every", "0s", cwd=tmp_path, main="tests.helpers.killed:main")
    resumed = mls(*there, "--resume", cwd=tmp_path)

    assert (killed.returncode, resumed.returncode) == (-9, 0)
    assert "tiles were evaluated before" in resumed.stderr
    assert (tmp_path / "map.npz").read_bytes() == (tmp_path / "whole.npz").read_bytes()
    assert not (tmp_path / "map.npz.checkpoint").exists()
