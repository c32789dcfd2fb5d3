"""`mls build`, as a user runs it.

How one could cheat: bad input that fails for another reason than the one it is there for; an
error line that is one of many; a folder that is looked at before it is written to.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from mlscli.io.writing.npz import read_map
from tests.helpers.bags import Sent, write_bag
from tests.helpers.pcds import pcd
from tests.helpers.program import mls
from tests.helpers.published import published

FLAT = [
    (0.1 * x + 0.05, 0.1 * y + 0.05, 0.01 * ((x + y) % 2)) for x in range(20) for y in range(20)
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a cloud of two keyframes in it."""
    rows = [f"{x:.2f} {y:.2f} {z:.2f} {int(x > 1)}" for x, y, z in FLAT]
    (tmp_path / "flight.txt").write_text("\n".join(rows) + "\n")
    return tmp_path


def test_a_map_is_built_beside_a_summary_that_accounts_for_every_point(folder: Path) -> None:
    done = mls("build", "flight.txt", cwd=folder)
    assert done.returncode == 0, done.stderr
    surface = read_map(folder / "flight.npz")
    assert surface.cell_size == 0.2
    assert int(surface.count.sum()) == 400
    assert "400 read: 400 kept" in done.stdout
    assert "2 in 2 batches" in done.stdout
    assert "0.2 (auto: twice the usual distance of a point to its fourth neighbour)" in done.stdout
    assert f"{surface.gap_size:.6g} (auto: half a cell, as only 0.0% of" in done.stdout
    assert set(surface.meta["sizes"]) == {"cell_size", "gap_size"}
    # It says how it read the columns, and that ten cells are few; no bar moves unwatched.
    assert done.stderr.count("\n") == 2
    assert "keyframe" in done.stderr
    assert "mls: cell_size: auto: 0.2 is coarse for a scene of 1.9 by 1.9" in done.stderr
    assert "\r" not in done.stderr


def test_the_summary_as_json_has_the_numbers_of_the_map(folder: Path) -> None:
    arguments = (
        "--set",
        "map.cell_size=0.1",
        "--set",
        "median.min_nb=4",
        "--set",
        "median.nb_radius=0.11",
        "--set",
        "median.layer_share=0",
    )
    done = mls("build", "flight.txt", "-o", "a.npz", "--json", *arguments, cwd=folder)
    account = json.loads(done.stdout)
    surface = read_map(folder / "a.npz")
    assert account["map"] == "a.npz"
    assert account["patches"]["total"] == surface.size
    assert account["patches"]["measured"] == int((surface.origin == 0).sum())
    points = account["points"]
    assert points["read"] == 400
    assert points["kept"] + sum(points["dropped"].values()) == 400
    # On the rim of the lattice, points have fewer than four neighbours.
    assert points["dropped"]["median"] == 4 * 19
    assert account["lost"] == []
    assert account["vehicle"] == {"width": 0.1, "height": pytest.approx(0.3)}


def test_the_summary_names_the_craft_that_the_map_is_made_for(folder: Path) -> None:
    # Wider than five cells, in cells that are known only once the points are.
    craft = ("--set", "vehicle.width=3.5", "--set", "vehicle.height=4 cells")
    for more, cells in (((), ""), (("--dry-run",), ""), (("--set", "map.cell_size=0.2"), " (0.8)")):
        done = mls("build", "flight.txt", "--overwrite", *craft, *more, cwd=folder)
        assert done.returncode == 0, done.stderr
        (row,) = [line for line in done.stdout.splitlines() if line.startswith("  vehicle ")]
        known = cells or " (0.8)" * ("--dry-run" not in more)
        assert row.split(maxsplit=1)[1] == f"3.5 wide, 4 cells high{known}"
    stages = read_map(folder / "flight.npz").meta["parameters"]["pipeline"]
    assert [s["plaster"]["max_gap_enhanced"] for s in stages if "plaster" in s] == [3.5]


def test_several_sources_are_one_flight(folder: Path) -> None:
    (folder / "second.txt").write_text("0.05 0.05 3\n")
    done = mls("build", "flight.txt", "second.txt", "-c", "plain", "-o", "both.npz", cwd=folder)
    assert done.returncode == 0, done.stderr
    surface = read_map(folder / "both.npz")
    assert len(surface.route) == 3
    assert surface.last_keyframe.max() == 2
    assert surface.meta["sources"] == ["flight.txt", "second.txt"]


def test_selection_options_reach_the_recording(folder: Path) -> None:
    plain = ("-c", "plain", "--set", "map.cell_size=0.1", "--overwrite", "-o", "m.npz")
    cropped = mls("build", "flight.txt", "--crop", "0,1,0,1,-9,9", *plain, "--json", cwd=folder)
    assert json.loads(cropped.stdout)["points"]["dropped"] == {"outside the crop": 300}
    turned = mls("build", "flight.txt", "--up", "-z", *plain, cwd=folder)
    assert turned.returncode == 0, turned.stderr
    assert read_map(folder / "m.npz").height.min() == -0.01
    mls("build", "flight.txt", "--every", "2", *plain, cwd=folder)
    assert len(read_map(folder / "m.npz").route) == 1


def test_the_map_says_how_its_sources_were_read(folder: Path) -> None:
    options = ("--up", "-z", "--columns", "x,y,z,keyframe", "--crop", "0,2,-2,0,-1,1")
    assert mls("build", "flight.txt", *options, cwd=folder).returncode == 0
    reading = {"columns": "x,y,z,keyframe", "crop": [0, 2, -2, 0, -1, 1], "up": "-z"}
    assert read_map(folder / "flight.npz").meta["reading"] == reading
    assert "up: -z" in mls("info", "flight.npz", cwd=folder).stdout


def test_the_map_holds_its_turn_whole_whichever_way_it_is_built(folder: Path) -> None:
    rng = np.random.default_rng(1)
    slope = Rotation.from_euler("x", 3, degrees=True)
    ground = np.column_stack((rng.uniform(-9, 9, (3000, 2)), np.zeros(3000)))
    np.savetxt(folder / "far.xyz", np.add(slope.apply(ground), (2000, -3000, 50)))
    options = ("--set", "map.cell_size=1", "-c", "plain", "-o", "far.npz", "--overwrite")
    turns = []
    for others in ((), ("--growing",), ("--jobs", "2"), ("--memory", "1G")):
        done = mls("build", "far.xyz", "--up", "auto", *options, *others, cwd=folder)
        assert done.returncode == 0, done.stderr
        surface = read_map(folder / "far.npz")
        turns.append(surface.meta["map_from_recording"])
    assert all(turn == turns[0] for turn in turns)
    np.testing.assert_allclose(np.array(turns[0])[2, :3], slope.apply([0, 0, 1]), atol=1e-2)
    # The middle stays.
    assert abs(surface.height.mean() - 50) < 0.2
    assert abs(surface.ix.mean() - 2000) < 2
    for up, row in (("z", [0, 0, 1, 0]), ("-y", [0, -1, 0, 0])):
        assert mls("build", "flight.txt", "--up", up, *options, cwd=folder).returncode == 0
        turn = read_map(folder / "far.npz").meta["map_from_recording"]
        assert turn[2:] == [row, [0, 0, 0, 1]]


def test_an_axis_that_the_recording_contradicts_is_told_with_the_option_to_use(
    folder: Path,
) -> None:
    rng = np.random.default_rng(2)
    ground = np.column_stack((rng.uniform(0, 20, (2000, 2)), rng.normal(0, 0.02, 2000)))
    parts = [ground[:, [0, 2, 1]]]
    for angle in np.radians((0, 35, 80, 110, 150)):
        along, high = rng.uniform(-3, 3, 500), rng.uniform(0, 4, 500)
        x, y = 10 + along * np.cos(angle), 10 + along * np.sin(angle)
        parts.append(np.column_stack((x, -high, y)) + rng.normal(0, 0.02, (500, 3)))
    np.savetxt(folder / "tipped.xyz", np.concatenate(parts))
    options = ("-c", "plain", "--set", "map.cell_size=1", "--overwrite")
    for command in (("build", *options), ("build", "--dry-run", *options), ("info",)):
        done = mls(*command, "tipped.xyz", cwd=folder)
        assert done.returncode == 0, done.stderr
        said = done.stdout + done.stderr
        assert said.count("--up z is doubtful, try --up auto: it seems that up is -y") == 1
    for up in ("-y", "auto"):
        assert "doubtful" not in mls("build", "tipped.xyz", "--up", up, *options, cwd=folder).stderr


def test_a_bag_of_two_cloud_topics_wants_a_topic(folder: Path) -> None:
    clouds = [Sent(np.array(FLAT))]
    write_bag(folder / "two.bag", clouds, topics=("/front", "/rear"))
    refused = mls("build", "two.bag", cwd=folder)
    assert refused.returncode == 2
    assert "/front" in refused.stderr
    assert "/rear" in refused.stderr
    assert "--topic" in refused.stderr
    assert refused.stderr.count("\n") == 1
    assert not (folder / "two.npz").exists()
    assert mls("build", "two.bag", "--topic", "/rear", cwd=folder).returncode == 0


def test_a_bag_that_lacks_messages_is_mapped_with_status_3(folder: Path) -> None:
    bag = write_bag(folder / "flight", [Sent(np.array(FLAT))] * 3, "ros2")
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 3", "message_count: 5"))
    done = mls("build", "flight", cwd=folder)
    assert done.returncode == 3
    assert "lost: 2 messages" in done.stderr
    assert read_map(folder / "flight.npz").size > 0


def test_a_map_that_grows_is_the_same_and_tells_its_pace(folder: Path) -> None:
    rows = [f"{x} {y} {z} {int(x > 1)} {100 + 10 * (x > 1)}" for x, y, z in FLAT]
    (folder / "timed.txt").write_text("\n".join(rows))
    build = ("build", "timed.txt", "--columns", "x,y,z,keyframe,t", "--json")
    accounts = {}
    for name, options in {
        "at once": (),
        "growing": ("--growing",),
        "sequential": ("--set", "mode=sequential"),
    }.items():
        done = mls(*build, "-o", f"{name}.npz", *options, cwd=folder)
        assert done.returncode == 0, done.stderr
        accounts[name] = json.loads(done.stdout)
    assert read_map(folder / "growing.npz") == read_map(folder / "at once.npz")
    assert accounts["growing"]["points"] == accounts["at once"]["points"]
    assert accounts["at once"]["pace"] is None
    for name in ("growing", "sequential"):
        pace = accounts[name]["pace"]
        # Two batches in ten seconds.
        assert pace["flight_per_batch"] == 5.0
        assert 0 < pace["slowest_batch"] < accounts[name]["seconds"]["total"]
    told = mls("build", "flight.txt", "--growing", cwd=folder).stdout
    assert "the flight has no times" in told


def test_headers_without_times_are_told_with_the_option_that_helps(folder: Path) -> None:
    write_bag(folder / "zero.bag", [Sent(np.array(FLAT))] * 3)
    hint = "--time-source log takes the times of recording"
    assert hint in mls("build", "zero.bag", cwd=folder).stderr
    selected = ("build", "zero.bag", "--overwrite", "--start", "1e-9")
    done = mls(*selected, cwd=folder)
    assert done.returncode == 1
    assert hint in done.stderr.splitlines()[-1]
    helped = mls(*selected, "--time-source", "log", "--json", cwd=folder)
    assert json.loads(helped.stdout)["keyframes"] == 2
    assert hint not in helped.stderr


def test_threads_make_the_same_file(folder: Path) -> None:
    for name, options in {"a": (), "b": ("--jobs", "1"), "c": ("--jobs", "3")}.items():
        done = mls("build", "flight.txt", "-o", f"{name}.npz", *options, cwd=folder)
        assert done.returncode == 0, done.stderr
    files = [(folder / f"{name}.npz").read_bytes() for name in "abc"]
    assert files[0] == files[1] == files[2]


def test_clouds_that_no_pose_reaches_are_told_with_their_time(
    folder: Path, shared_data: Path
) -> None:
    bag = shared_data / "bags/ros1_luminar_pc2_lz4.bag"
    poses = ("--topic", "/luminar_pointcloud", "--pose-topic", "/base_pose_ground_truth")
    done = mls("build", bag, *poses, cwd=folder)
    assert done.returncode == 1
    # The clouds are of March 2020, the poses of a simulation that runs for a minute.
    assert "the clouds begin at 1583971570.015 s" in done.stderr
    assert "--time-source log" in done.stderr
    again = mls("build", bag, *poses, "--time-source", "log", cwd=folder)
    assert "--time-source header" in again.stderr


def test_a_replay_ends_with_the_map_and_leaves_it_the_same(folder: Path) -> None:
    assert mls("build", "flight.txt", "-o", "alone.npz", cwd=folder).returncode == 0
    done = mls("build", "flight.txt", "--replay", "grown.mcap", cwd=folder)
    assert done.returncode == 0, done.stderr
    surface = read_map(folder / "flight.npz")
    assert surface == read_map(folder / "alone.npz")
    with AnyReader([folder / "grown.mcap"]) as reader:
        (topic,) = (each for each in reader.connections if each.topic == "/mls/patches")
        sizes = [
            reader.deserialize(data, each.msgtype).width  # type: ignore[attr-defined]
            for each, _, data in reader.messages([topic])
        ]
    # The two halves of the flight are two batches.
    assert len(sizes) == 2
    assert sizes[0] < sizes[1] == surface.size


BAD_INPUT = {
    "no such file": (["nosuch.bag"], 1, "nosuch.bag: "),
    "a folder without a bag": (["empty"], 1, "metadata.yaml"),
    "an empty cloud": (["empty.txt"], 1, "empty.txt: "),
    "a cloud of comments": (["comments.txt"], 1, "comments.txt: "),
    "a broken line": (["broken.txt"], 1, "broken.txt:2: "),
    "nothing but NaN": (["nan.txt"], 1, "nan.txt: "),
    "an existing output": (["flight.txt", "-o", "there.npz"], 1, "there.npz: exists already"),
    "an output that is the source": (
        ["flight.txt", "-o", "./flight.txt", "--overwrite"],
        1,
        "is the source itself",
    ),
    "a replay that is there": (["flight.txt", "--replay", "there.npz"], 1, "exists already"),
    "a replay that is the map": (
        ["flight.txt", "-o", "a.npz", "--replay", "./a.npz"],
        2,
        "--replay ./a.npz: is the map's name",
    ),
    "a replay that is the source": (
        ["flight.txt", "--replay", "flight.txt", "--overwrite"],
        1,
        "is the source itself",
    ),
    "an output that is no map": (["flight.txt", "-o", "flight.PLY"], 2, "a map is a .npz file"),
    "a map of nothing": (
        ["flight.txt", "--columns", "x,y,z,keyframe", "--set", "map.cell_size=0.0001"],
        1,
        "no point is left to map: of 400 read, dropped were 400 (orphans)",
    ),
    "standard input without a name for the map": (["-"], 2, "has no name to take"),
    "an empty standard input": (["-", "-o", "m.npz"], 1, "/dev/stdin: holds nothing"),
    "a trajectory for a cloud": (["tum.txt"], 1, "name the cloud, and this file after --route"),
    "decimal commas": (
        ["commas.csv"],
        1,
        "commas.csv:2: found '1,5' as x, expected a number",
    ),
    "an output in no folder": (["flight.txt", "-o", "no/m.npz"], 1, "no/m.npz: "),
    "a typo in the YAML": (["flight.txt", "-c", "typo.yaml"], 2, "typo.yaml:2:3: "),
    "no such configuration": (["flight.txt", "-c", "nosuch.yaml"], 2, "nosuch.yaml: "),
    "a setting of no stage": (["flight.txt", "--set", "plastr.max_gap=1"], 2, "plaster"),
    "an axis that is none": (["flight.txt", "--up", "w"], 2, "--up w"),
    "a crop of five numbers": (["flight.txt", "--crop", "0,1,0,1,0"], 2, "xmin,xmax"),
    "columns without z": (["flight.txt", "--columns", "x,y,-,keyframe"], 2, "--columns"),
    "threads for a sequential map": (
        ["flight.txt", "--jobs", "2", "--set", "mode=sequential"],
        2,
        "--jobs",
    ),
    "threads for a growing map": (["flight.txt", "--jobs", "2", "--growing"], 2, "--jobs"),
    "no thread": (["flight.txt", "--jobs", "0"], 2, "--jobs"),
    "a scheduler for a sequential map": (
        ["flight.txt", "--scheduler", "local", "--set", "mode=sequential"],
        2,
        "--scheduler: a sequential map",
    ),
    "a scheduler for a growing map": (
        ["flight.txt", "--scheduler", "local", "--growing"],
        2,
        "--scheduler: does not go with --growing",
    ),
    "a scheduler for a replay": (
        ["flight.txt", "--scheduler", "local", "--replay", "a.mcap"],
        2,
        "--scheduler: does not go with --growing or --replay",
    ),
    "a scheduler and threads": (
        ["flight.txt", "--scheduler", "local", "--jobs", "2"],
        2,
        "--jobs: ",
    ),
    "workers that share the memory": (
        ["flight.txt", "--scheduler", "local", "--memory", "1G"],
        2,
        "--memory: does not count",
    ),
    "a scheduler nowhere": (
        ["flight.txt", "--scheduler", "10.0.0.1:8786"],
        2,
        "--scheduler 10.0.0.1:8786: is no address; write tcp://host:port",
    ),
    "an unknown option": (["flight.txt", "--cellsize", "1"], 2, "--cellsize"),
    "no source": ([], 2, "SOURCE"),
    "a limit below another": (
        ["flight.txt", "--set", "plaster.max_gap=9", "--set", "plaster.max_gap_enhanced=1"],
        2,
        "max_gap_enhanced",
    ),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_is_one_line_and_leaves_no_file(folder: Path, case: str) -> None:
    arguments, status, said = BAD_INPUT[case]
    (folder / "empty").mkdir()
    (folder / "empty.txt").write_text("")
    (folder / "comments.txt").write_text("# nothing\n# at all\n")
    (folder / "broken.txt").write_text("1 2 3\n1 2 three\n")
    (folder / "nan.txt").write_text("nan 2 3\n")
    (folder / "commas.csv").write_text("x;y;z\n1,5;2,5;3,5\n")
    (folder / "tum.txt").write_text("# stamp x y z\n1.5 0 0 0 0 0 0 1\n1.6 1 0 0 0 0.6 0 -0.8\n")
    (folder / "there.npz").write_text("precious")
    (folder / "typo.yaml").write_text("map:\n  cel_size: 0.1\n")
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    done = mls("build", *arguments, cwd=folder)
    assert done.returncode == status, done.stderr
    assert done.stdout == ""
    assert done.stderr.startswith("mls")
    assert done.stderr.count("\n") == 1, done.stderr
    assert said in done.stderr
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def test_an_output_is_replaced_when_asked(folder: Path) -> None:
    for options, status in (([], 0), ([], 1), (["--overwrite"], 0)):
        assert mls("build", "flight.txt", *options, cwd=folder).returncode == status


def test_a_map_that_is_published_again_is_told_and_its_last_message_can_be_taken(
    tmp_path: Path,
) -> None:
    clouds = published(8, lambda time: 0.6 * (1 - time), points=400)
    write_bag(tmp_path / "slam.bag", [Sent(cloud, k * 10**9) for k, cloud in enumerate(clouds)])
    size = ("--set", "map.cell_size=0.5", "-c", "plain")
    done = mls("build", "slam.bag", *size, cwd=tmp_path)
    (line,) = [line for line in done.stderr.splitlines() if "published again" in line]
    assert "--latest" in line
    assert "--cumulative" in line
    done = mls("build", "slam.bag", "--latest", "-o", "last.npz", *size, cwd=tmp_path)
    assert "mls: --latest: the last message alone is taken, of 8\n" in done.stderr
    assert "published again" not in done.stderr
    assert "400 read: 400 kept" in done.stdout
    surface = read_map(tmp_path / "last.npz")
    assert int(surface.count.sum()) == 400
    assert surface.meta["reading"] == {"latest": True}
    done = mls("build", "slam.bag", "--cumulative", "-o", "all.npz", *size, cwd=tmp_path)
    assert "mls: --cumulative: nothing was dropped" in done.stderr
    done = mls("build", "slam.bag", "--latest", "--cumulative", "-o", "no.npz", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "mls: --latest: does not go with --cumulative; leave one of them out\n"


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("map.cell_size=1", "mls: map.cell_size 1: all of the map lies in 4 cells; "),
        ("map.gap_size=10 cells", "mls: map.gap_size 2: is more than 3 times the height of the v"),
        ("map.gap_size=9 cells", ""),
    ],
)
def test_sizes_beyond_reason_are_doubted(folder: Path, setting: str, words: str) -> None:
    sets = ("--set", "map.cell_size=0.2", "--set", setting)
    done = mls("build", "flight.txt", "--columns", "x,y,z,-", *sets, "-c", "plain", cwd=folder)
    assert done.returncode == 0
    assert done.stderr.startswith(words)
    assert done.stderr.count("\n") == bool(words)


def test_coordinates_that_lost_their_digits_are_told(tmp_path: Path) -> None:
    points = np.random.default_rng(1).uniform(0, 40, (3000, 3))
    far = (points + np.array([356_000, 5_572_094, 100])).astype("<f4")
    (tmp_path / "far.pcd").write_bytes(
        pcd("binary", far.tobytes(), WIDTH=len(far), POINTS=len(far))
    )
    fine, coarse = (
        mls("build", "far.pcd", "--overwrite", "--set", f"map.cell_size={size}", cwd=tmp_path)
        for size in (8, 2)
    )

    assert "lies on steps" not in fine.stderr
    assert "a coordinate lies on steps of 0.5" in coarse.stderr
