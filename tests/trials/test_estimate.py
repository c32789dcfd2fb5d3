"""What a build would do, told from the first keyframes.

How one could cheat: build the whole map after all; repeat the numbers of what was read; give
numbers where there is nothing to judge by; scale a map of ground that is seen again and again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.building.build import build
from mlscli.errors import InputError
from mlscli.io.reading.glance import Glance
from mlscli.io.reading.recording import open_recording
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Float64
from mlscli.trials.estimate import estimate_build
from tests.helpers.bags import Sent, write_bag

SECOND = 10**9


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a busy machine change no numbers."""
    monkeypatch.setattr("mlscli.trials.estimate._PATIENCE_SECONDS", 600.0)


def unhurried() -> Glance:
    """Return a look at a whole short recording."""
    return Glance(seconds=60)


def tenth() -> Glance:
    """Return a look at ten of a hundred keyframes."""
    return Glance(points=2000, seconds=60)


def strip(begin: float, end: float, seed: int, count: int = 200) -> Float64:
    """Return points of a floor, 4 wide, between two places of its length."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((begin, 0, -0.01), (end, 4, 0.01), (count, 3))
    return np.asarray(points.round(4))


def onwards(keyframes: int = 100) -> list[Sent]:
    """Return a flight over new ground with every keyframe."""
    return [Sent(strip(k, k + 1, k), k * SECOND) for k in range(keyframes)]


def test_of_a_short_recording_all_numbers_are_those_of_the_build(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", onwards(9))
    estimate = estimate_build(bag, glance=unhurried())
    built = build(open_recording(bag)).surface
    meta = built.meta
    assert estimate.whole
    assert estimate.keyframes == meta["keyframes"] == 9
    assert estimate.points == meta["points"]["read"] == 1800
    assert estimate.read["dropped"] == meta["points"]["dropped"]
    assert (estimate.batches, estimate.patches) == (meta["batches"], built.size)
    assert (estimate.cell_size, estimate.gap_size) == (built.cell_size, built.gap_size)
    assert estimate.sizes == meta["sizes"] != {}
    assert (estimate.thickness, estimate.frame_id) == (built.thickness, built.frame_id)
    assert estimate.seconds is not None
    assert estimate.seconds > 0


def test_of_a_flight_over_new_ground_all_grows_with_the_keyframes(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", onwards())
    estimate = estimate_build(bag, glance=tenth())
    assert not estimate.whole
    assert estimate.read["keyframes"] == 10
    assert estimate.counted
    assert (estimate.keyframes, estimate.batches, estimate.points) == (100, 100, 20_000)
    built = build(open_recording(bag)).surface
    assert estimate.cell_size == pytest.approx(built.cell_size, rel=0.1)
    assert estimate.patches == pytest.approx(built.size, rel=0.1)


def test_free_space_grows_with_the_flight_and_needs_positions(tmp_path: Path) -> None:
    parameters = Parameters().with_cell_size(0.2).with_free_space()
    rows = [
        (*point, number, number, 0.5, 3.0)
        for number, sent in enumerate(onwards())
        for point in sent.points.tolist()
    ]
    np.savetxt(tmp_path / "a.txt", rows, fmt="%.4f")
    columns = "x,y,z,keyframe,cx,cy,cz"
    built = build(open_recording(tmp_path / "a.txt", columns=columns), parameters).surface
    foreseen = estimate_build(
        tmp_path / "a.txt", parameters=parameters, glance=tenth(), columns=columns
    )
    assert built.free is not None
    assert not foreseen.whole
    assert foreseen.voxels == pytest.approx(built.free.size, rel=0.2)
    nowhere = write_bag(tmp_path / "a.bag", onwards())
    foreseen = estimate_build(nowhere, parameters=parameters, glance=tenth())
    assert any("not known of any keyframe read so far" in note for note in foreseen.notes)
    with pytest.raises(InputError, match="`free_space`: where the craft was is not known of any"):
        estimate_build(nowhere, parameters=parameters, glance=unhurried())


def test_ground_that_is_seen_again_adds_few_patches(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", [Sent(strip(0, 2, k), k * SECOND) for k in range(100)])
    parameters = Parameters(pipeline=()).with_cell_size(0.5)
    estimate = estimate_build(bag, parameters=parameters, glance=tenth())
    # All four by eight cells are seen by the first keyframes.
    assert estimate.patches == 32


def test_nothing_but_the_first_keyframes_is_read(tmp_path: Path) -> None:
    clouds = onwards()
    bag = write_bag(tmp_path / "a.bag", clouds)
    data = bytearray(bag.read_bytes())
    place = data.index(clouds[50].points[0].astype("<f8").tobytes())
    # The message of another size than its fields declare.
    size = data.rindex((200 * 28).to_bytes(4, "little"), 0, place)
    data[size : size + 4] = (7).to_bytes(4, "little")
    bag.write_bytes(data)
    recording = open_recording(bag)
    list(recording.keyframes())
    assert recording.losses
    assert not estimate_build(bag, glance=tenth()).lost


def test_the_last_message_alone_is_told_and_what_was_not_reached(tmp_path: Path) -> None:
    maps = [Sent(strip(0, 4, 1, 50 * k), k * SECOND) for k in range(1, 9)]
    bag = write_bag(tmp_path / "a.bag", maps)
    estimate = estimate_build(bag, glance=tenth(), latest=True)
    assert estimate.whole
    assert (estimate.keyframes, estimate.points) == (1, 400)
    assert estimate.patches == build(open_recording(bag, latest=True)).surface.size
    assert not any("not reached" in note for note in estimate.notes)
    hurried = estimate_build(bag, glance=Glance(seconds=-1), latest=True)
    assert not hurried.whole
    assert (hurried.keyframes, hurried.points) == (None, None)
    assert sum("not reached" in note for note in hurried.notes) == 1


def test_where_nothing_is_read_nothing_is_claimed(tmp_path: Path) -> None:
    estimate = estimate_build(write_bag(tmp_path / "a.bag", onwards()), glance=Glance(seconds=-1))
    assert not estimate.whole
    assert estimate.keyframes == 100
    assert estimate.frame_id == "map"
    unknown = (
        estimate.batches, estimate.points, estimate.patches, estimate.seconds, estimate.cell_size
    )  # fmt: skip
    assert unknown == (None,) * 5


def test_a_part_of_the_time_holds_a_part_of_the_keyframes(tmp_path: Path) -> None:
    rows = [f"{x} {y} {z} {k}" for k in range(100) for x, y, z in strip(k, k + 1, k).tolist()]
    (tmp_path / "a.txt").write_text("\n".join(rows))
    estimate = estimate_build(
        tmp_path / "a.txt", columns="x,y,z,t", start=10.0, end=59.0, glance=tenth()
    )
    assert estimate.read["keyframes"] == 10
    assert (estimate.keyframes, estimate.counted) == (50, False)
    assert estimate.points == 10_000


def test_a_single_large_cloud_is_judged_by_a_slab_as_dense(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mlscli.trials.estimate._AT_MOST", 2000)
    bag = write_bag(tmp_path / "a.bag", [Sent(strip(0, 50, 1, 20_000))])
    estimate = estimate_build(bag, glance=unhurried())
    built = build(open_recording(bag)).surface
    assert not estimate.whole
    assert (estimate.points, estimate.batches) == (20_000, 1)
    assert estimate.cell_size == pytest.approx(built.cell_size, rel=0.1)
    assert estimate.patches == pytest.approx(built.size, rel=0.15)


def test_the_vertical_is_told_as_it_was_found(shared_data: Path) -> None:
    bridge = shared_data / "multilevel/footbridge_yup_dddmr_map.pcd"
    assert estimate_build(bridge, up="y").up == "y"
    assert "from y" in estimate_build(bridge, up="auto").up


def test_of_a_wall_across_x_no_more_is_tried_than_of_a_floor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mlscli.trials.estimate._AT_MOST", 500)
    rng = np.random.default_rng(1)
    wall = rng.uniform((1, 0, 0), (1, 4, 3), (3000, 3))
    bag = write_bag(
        tmp_path / "a.bag", [Sent(part, k * SECOND) for k, part in enumerate((wall, wall))]
    )
    parameters = Parameters().with_cell_size(0.2)
    assert not estimate_build(bag, parameters=parameters, glance=unhurried()).whole
