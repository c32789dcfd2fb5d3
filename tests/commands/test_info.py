"""`mls info`, as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mlscli.io.writing.npz import write_map
from tests.helpers.bags import Sent, write_bag, write_told
from tests.helpers.craft import at, recorded, run, seen, transform
from tests.helpers.maps import Patch, map_of
from tests.helpers.program import mls

BRIDGE = [Patch(x, 0, 0.0, 0.0, 0, 4) for x in range(4)] + [
    Patch(1, 0, 3.0, 0.5, 0, 4),
    Patch(2, 0, 3.0, 0.0, 2, 0),
]


def test_of_a_map_it_tells_patches_levels_and_what_made_it(tmp_path: Path) -> None:
    surface = map_of(BRIDGE)
    surface.meta.update({"sources": ["flight.bag"], "parameters": {"mode": "consistent"}})
    write_map(tmp_path / "bridge.npz", surface)
    text = mls("info", "bridge.npz", cwd=tmp_path)
    assert text.returncode == 0, text.stderr
    assert "6: 5 measured, 1 artificial; 1 vertical" in text.stdout
    assert "flight.bag" in text.stdout
    told = json.loads(mls("info", "bridge.npz", "--json", cwd=tmp_path).stdout)[0]
    assert told["patches"] == {
        "total": 6, "measured": 5, "plastered": 0, "artificial": 1, "vertical": 1, "moved": 0,
    }  # fmt: skip
    assert told["levels"] == {"1": 2, "2": 2}
    variance = surface.height_variance[surface.origin == 0]
    known, rms, within = told["uncertainty"].values()
    assert (known, within) == (5, int(np.sum(variance <= 0.125**2)))
    assert abs(rms - np.sqrt(np.mean(variance))) < 1e-12
    assert " rms expected of 5 heights, " in text.stdout
    assert told["extent"] == {"x": [0.0, 2.0], "y": [0.0, 0.5], "z": [0.0, 3.0]}
    assert told["meta"]["sources"] == ["flight.bag"]
    assert told["up"] == "z"
    assert "turned" not in text.stdout


def test_of_a_map_that_was_turned_it_tells_what_was_up(tmp_path: Path) -> None:
    for name, turn in (
        ("turned", [[1, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]]),
        ("odd", [1, 2]),
    ):
        surface = map_of(BRIDGE)
        surface.meta["map_from_recording"] = turn
        write_map(tmp_path / f"{name}.npz", surface)
    done = mls("info", "odd.npz", "turned.npz", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("mls: odd.npz: meta: map_from_recording holds [1, 2]")
    assert done.stderr.count("\n") == 1
    assert "what was -y is up" in done.stdout
    # No cloud is there that could be turned.
    assert mls("info", "turned.npz", "--up", "y", cwd=tmp_path).returncode == 2


def test_of_a_map_it_tells_how_many_patches_lie_beyond_their_points(tmp_path: Path) -> None:
    surface = map_of(BRIDGE)
    drawn = surface.with_columns(depth=np.where(surface.depth > 0, 1.0, 0.0))
    write_map(tmp_path / "bridge.npz", drawn)
    assert "; 1 vertical, 1 moved\n" in mls("info", "bridge.npz", cwd=tmp_path).stdout
    told = json.loads(mls("info", "bridge.npz", "--json", cwd=tmp_path).stdout)[0]
    assert told["patches"]["moved"] == 1


def test_of_a_bag_it_tells_topics_frames_and_time(tmp_path: Path) -> None:
    clouds = [Sent(np.zeros((2, 3)), nanoseconds=10**9 * k, frame_id="odom") for k in range(3)]
    write_bag(tmp_path / "flight.bag", clouds, topics=("/a", "/b"))
    done = mls("info", "flight.bag", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)[0]
    assert told["kind"] == "ROS 1 bag"
    assert [topic["name"] for topic in told["topics"]] == ["/a", "/b"]
    for topic in told["topics"]:
        assert topic["type"] == "sensor_msgs/msg/PointCloud2"
        assert topic["messages"] == 3
        assert topic["frame"] == "odom"
        assert topic["mappable"]
    assert "can be mapped" in mls("info", "flight.bag", cwd=tmp_path).stdout


def test_of_a_topic_that_cannot_be_mapped_it_says_why(tmp_path: Path) -> None:
    write_bag(tmp_path / "lidar.bag", [Sent(np.zeros((2, 3)), frame_id="os_sensor")])
    topic = json.loads(mls("info", "lidar.bag", "--json", cwd=tmp_path).stdout)[0]["topics"][0]
    assert not topic["mappable"]
    assert "os_sensor" in topic["why_not"]


def test_of_a_text_cloud_it_tells_extent_and_levels(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    floor = np.c_[rng.uniform(0, 4, (2000, 2)), rng.normal(0, 0.01, 2000)]
    storey = floor[floor[:, 0] < 2] + (0, 0, 3)
    np.savetxt(tmp_path / "house.xyz", np.concatenate((floor, storey)))
    told = json.loads(mls("info", "house.xyz", "--json", cwd=tmp_path).stdout)[0]
    assert told["points"] == 2000 + len(storey)
    assert told["keyframes"] == 1
    np.testing.assert_allclose(told["extent"]["x"], [0, 4], atol=0.05)
    two, one = told["levels"]["2"], told["levels"]["1"]
    assert 0.4 < two / (one + two) < 0.6
    assert "extent" in mls("info", "house.xyz", cwd=tmp_path).stdout


def two_storeys(path: Path) -> None:
    """Write a PLY of two floors of 10 x 10 points, 3 apart."""
    rows = [f"{0.2 * x} {0.2 * y} {z}" for z in (0, 3) for x in range(10) for y in range(10)]
    header = ["ply", "format ascii 1.0", "element vertex 200"]
    header += [f"property float {axis}" for axis in "xyz"]
    path.write_text("\n".join([*header, "end_header", *rows, ""]))


def test_of_any_file_of_points_it_tells_extent_and_levels(tmp_path: Path) -> None:
    two_storeys(tmp_path / "house.ply")
    done = mls("info", "house.ply", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (told,) = json.loads(done.stdout)
    assert told["kind"] == "PLY cloud"
    assert (told["points"], told["keyframes"], told["lost"]) == (200, 1, [])
    np.testing.assert_allclose([told["extent"][axis] for axis in "xyz"], [[0, 1.8]] * 2 + [[0, 3]])
    assert set(told["levels"]) == {"2"}


def test_of_a_file_that_was_cut_it_tells_what_is_lost(tmp_path: Path) -> None:
    two_storeys(tmp_path / "house.ply")
    content = (tmp_path / "house.ply").read_bytes()
    (tmp_path / "house.ply").write_bytes(content[:-100])
    done = mls("info", "house.ply", cwd=tmp_path)
    assert done.returncode == 3
    assert "of 200 points are missing" in done.stdout


def test_of_a_reconstruction_it_tells_the_route(shared_data: Path) -> None:
    text = mls("info", shared_data / "sparse/colmap_pysfm").stdout
    assert "14,073 in 11 keyframes" in text
    assert "where the craft was is known of 11 keyframes" in text


def test_what_is_neither_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 and no more")
    (tmp_path / "noise").write_bytes(bytes(range(256)))
    for name in ("broken.npz", "noise", "nosuch"):
        done = mls("info", name, cwd=tmp_path)
        assert done.returncode == 1
        assert name in done.stderr
        assert done.stderr.count("\n") == 1


def test_files_that_can_be_read_are_described_beside_those_that_cannot(tmp_path: Path) -> None:
    write_map(tmp_path / "bridge.npz", map_of(BRIDGE))
    done = mls("info", "nosuch", "bridge.npz", "--json", cwd=tmp_path)
    assert done.returncode == 1
    assert "nosuch" in done.stderr
    assert [told["file"] for told in json.loads(done.stdout)] == ["bridge.npz"]


def test_of_the_real_bags_it_names_every_topic(shared_data: Path) -> None:
    (told,) = json.loads(
        mls("info", shared_data / "bags/ros1_luminar_pc2_lz4.bag", "--json").stdout
    )
    topics = {topic["name"]: topic for topic in told["topics"]}
    assert {name: topic["use"] for name, topic in topics.items()} == {
        "/base_pose_ground_truth": "poses",
        "/base_scan": "clouds",
        "/luminar_pointcloud": "clouds",
    }
    for name in ("/base_scan", "/luminar_pointcloud"):
        assert not topics[name]["mappable"]
        assert topics[name]["frame"] in topics[name]["why_not"]
        assert "--pose-topic /base_pose_ground_truth" in topics[name]["why_not"]
    (told,) = json.loads(mls("info", shared_data / "bags/ros2_jackal_scan_pose", "--json").stdout)
    scans = {topic["type"]: topic["messages"] for topic in told["topics"]}
    assert scans["sensor_msgs/msg/LaserScan"] == 189


def test_of_transforms_it_tells_how_frames_hang_and_where_clouds_come(shared_data: Path) -> None:
    bag = shared_data / "bags/ros1_tilt_laser_tf.bag"
    (told,) = json.loads(mls("info", bag, "--json").stdout)
    assert {(link["parent"], link["child"]) for link in told["frames"]} == {
        ("tilt_base", "tilt_axis"), ("tilt_axis", "camera"), ("tilt_axis", "laser"),
    }  # fmt: skip
    topics = {topic["name"]: topic for topic in told["topics"]}
    assert topics["/tf"]["use"] == "transforms"
    assert topics["/imu_data"]["use"] is None
    assert topics["/scan"]["map_frame"] == "tilt_base"
    shown = mls("info", bag).stdout
    assert "moved into 'tilt_base'" in shown
    assert "\n    tilt_base\n      tilt_axis (moves)\n        camera" in shown


def test_of_a_bag_without_messages_it_says_so(shared_data: Path) -> None:
    done = mls("info", shared_data / "bags/ros1_no_messages.bag")
    assert done.returncode == 0, done.stderr
    assert "topics  none" in done.stdout


def test_a_bag_whose_first_cloud_is_broken_is_described(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", [Sent(np.ones((5, 3)), frame_id="odom")] * 3)
    # Of the first message the field x gets another name.
    bag.write_bytes(bag.read_bytes().replace(b"\1\0\0\0x", b"\1\0\0\0q", 1))
    done = mls("info", "a.bag", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (topic,) = json.loads(done.stdout)[0]["topics"]
    assert (topic["messages"], topic["frame"], topic["mappable"]) == (3, "odom", True)
    built = mls("build", "a.bag", "--set", "map.cell_size=1", "-c", "plain", cwd=tmp_path)
    assert built.returncode == 3
    assert "1 of 3 messages" in built.stderr


def test_what_is_lost_of_a_bag_is_told_with_status_3(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", [Sent(np.ones((50, 3)), frame_id="odom")] * 3)
    bag.write_bytes(bag.read_bytes()[:-700])
    done = mls("info", "a.bag", cwd=tmp_path)
    assert done.returncode == 3
    assert "\n  lost " in done.stdout


def test_levels_are_counted_along_the_axis_that_points_up(tmp_path: Path) -> None:
    rows = [f"{0.2 * x} {y} {0.2 * z}" for y in (0, 3) for x in range(20) for z in range(20)]
    (tmp_path / "house.xyz").write_text("\n".join(rows))
    two_storeys(tmp_path / "other.ply")

    def levels(*options: str) -> set[str]:
        done = mls("info", "house.xyz", *options, "--json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return set(json.loads(done.stdout)[0]["levels"])

    assert levels("--up", "y") == levels("--up", "-y") == {"2"}
    assert "2" not in levels()
    wrong = mls("info", "house.xyz", "--up", "upwards", cwd=tmp_path)
    assert wrong.returncode == 2
    both = mls("info", "house.xyz", "other.ply", "--columns", "x,y,z", "--json", cwd=tmp_path)
    assert len(json.loads(both.stdout)) == 2


def test_options_that_fit_no_file_are_refused(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", [Sent(np.ones((5, 3)))])
    for option in (("--columns", "x,y,z"), ("--up", "y")):
        done = mls("info", "a.bag", *option, cwd=tmp_path)
        assert done.returncode == 2
        assert " ".join(option) in done.stderr
        assert done.stdout == ""


def test_of_two_points_there_is_an_extent_and_no_levels(tmp_path: Path) -> None:
    (tmp_path / "two.xyz").write_text("0 0 0\n1 2 3\n")
    done = mls("info", "two.xyz", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (told,) = json.loads(done.stdout)
    assert told["extent"] == {"x": [0, 1], "y": [0, 2], "z": [0, 3]}
    assert told["levels"] == {}
    assert "levels cannot be told" in mls("info", "two.xyz", cwd=tmp_path).stdout


@pytest.mark.parametrize(
    "meta",
    [
        {"points": "x", "parameters": 5, "reading": 3, "sources": 7, "batches": "many"},
        {"parameters": {"pipeline": 4, "map": None}, "sources": [1, None], "sizes": []},
        {"parameters": {"pipeline": [3, {"median": None}]}, "sizes": {"cell_size": 1}},
    ],
)
def test_a_map_is_told_of_whatever_another_program_has_written_into_its_meta(
    tmp_path: Path, meta: dict[str, object]
) -> None:
    surface = map_of(BRIDGE)
    surface.meta.update(meta)
    write_map(tmp_path / "odd.npz", surface)
    done = mls("info", "odd.npz", cwd=tmp_path)

    assert (done.returncode, done.stderr) == (0, "")
    assert "6: 5 measured, 1 artificial; 1 vertical" in done.stdout


def test_many_numbers_of_levels_are_told_on_one_line(tmp_path: Path) -> None:
    tower = [Patch(x, 0, 5.0 * n, 0.0, 0, 4) for x in range(20) for n in range(x + 1)]
    write_map(tmp_path / "tower.npz", map_of(tower))
    done = mls("info", "tower.npz", cwd=tmp_path)

    (line,) = [line for line in done.stdout.splitlines() if line.startswith("  levels")]
    assert line.endswith("1 cell with 5, 15 cells with 6 to 20")
    assert len(line) < 120


def test_two_robots_on_one_topic_are_told(tmp_path: Path) -> None:
    told = [each for pair in zip(run(0, 0), run(0, 100), strict=True) for each in pair]
    write_told(tmp_path / "flight.bag", [*told, *seen(0, 3)])

    said = mls("info", "flight.bag", cwd=tmp_path).stdout

    assert "'base_link' in 'map' is told at two places by turns" in said


def test_two_parents_of_a_frame_are_told(tmp_path: Path) -> None:
    told = [recorded(transform(k, name, "base_link", at(k)), k) for k in range(9) for name in "ab"]
    write_told(tmp_path / "flight.bag", [*told, *seen(0, 3)])

    said = mls("info", "flight.bag", cwd=tmp_path).stdout

    assert "'base_link' is told in 'a' and 'b' by turns" in said


def test_of_robots_with_name_spaces_it_tells_which_count_and_no_contradiction(
    tmp_path: Path,
) -> None:
    robots = [*run(0, 0, topic="/one/tf"), *run(0, 100, topic="/two/tf")]
    clouds = (each._replace(topic="/two/points") for each in seen(0, 3))
    write_told(tmp_path / "flight.bag", [*robots, *clouds])

    said = mls("info", "flight.bag", cwd=tmp_path).stdout

    assert "those count whose name space holds the topic of the clouds" in said
    assert "by turns" not in said
