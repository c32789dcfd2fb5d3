"""``mls synth``: what is written where, what options reach, and what is refused.

Ways to pass without being right: to look at the exit status alone, so the files are read; options
that change nothing.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import mlscli
from mlscli.commands.synth import command
from mlscli.errors import ConfigError, InputError, MlsError, OutputError, UsageError, with_options
from mlscli.io.writing.npz import read_map
from mlscli.keyframes.batches import gather
from mlscli.runtime.arrays import Float64
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.truth import truth
from tests.helpers.program import mls
from tests.scenes.clouds import level

pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def synth(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def points(*arguments: str) -> Float64:
    result = synth(*arguments, "-o", "flight.txt", "--overwrite")
    assert result.exit_code == 0, result.output
    return gather(mlscli.open_recording("flight.txt").keyframes()).points.xyz


def complaint(*arguments: str) -> BaseException:
    result = synth(*arguments)
    assert result.exit_code != 0
    assert result.exception is not None
    assert result.stdout == ""
    return result.exception


def test_the_default_output_is_the_scene_s_name_with_its_truth_beside_it(folder: Path) -> None:
    result = synth("--type", "1")
    assert {file.name for file in folder.iterdir()} == {"bridge.txt", "bridge.truth.npz"}
    size = gather(mlscli.open_recording("bridge.txt").keyframes()).points.size
    assert f"bridge.txt: {size:,} points in " in result.stdout
    assert "over 4 surfaces; bridge.truth.npz: 2,080 true patches" in result.stdout
    assert read_map("bridge.truth.npz") == truth(make("bridge"), 0.15, 0.5, 0.15)


@pytest.mark.parametrize(
    ("output", "kind"),
    [
        ("a.txt", "text cloud"), ("a.csv", "text cloud"), ("a.XYZ", "text cloud"),
        ("a.bag", "ROS 1 bag"), ("a.mcap", "MCAP"), ("a", "ROS 2 bag"),
    ],
)  # fmt: skip
def test_every_format_gives_the_same_map(output: str, kind: str) -> None:
    parameters = mlscli.load_parameters("default", ["map.cell_size=0.15"])
    synth("--type", "bridge-walls", "-o", "reference.txt")
    expected = mlscli.build_map(mlscli.open_recording("reference.txt"), parameters)
    assert synth("--type", "bridge-walls", "-o", output).exit_code == 0
    recording = mlscli.open_recording(output)
    assert [source.kind for source in recording._sources] == [kind]
    assert mlscli.build_map(recording, parameters) == expected
    assert read_map("a.truth.npz") == read_map("reference.truth.npz")


def test_json_says_what_was_written() -> None:
    account = json.loads(synth("--type", "planes", "--json").stdout)
    flight = gather(mlscli.open_recording("planes.txt").keyframes())
    assert account.pop("seconds") > 0
    assert account == {
        "recording": "planes.txt",
        "truth": "planes.truth.npz",
        "scene": "planes",
        "points": flight.points.size,
        "keyframes": len(flight.route),
        "surfaces": 3,
        "truth_patches": 1600,
    }


def test_the_list_has_a_line_for_each_scene() -> None:
    lines = synth("--list").stdout.splitlines()
    assert len(lines) == len(SCENE_PRESETS)
    assert lines[0].split()[:2] == ["1", "bridge"]
    assert "height of the bridge" in lines[0]
    names = [row["name"] for row in json.loads(synth("--list", "--json").stdout)]
    assert names == [preset.name for preset in SCENE_PRESETS]


def test_options_reach_the_flight() -> None:
    exact = ("--type", "bridge", "--sigma", "0,0", "--salt-pepper", "0")
    plain = points(*exact)
    assert set(plain[np.abs(plain[:, 1]) < 0.9][:, 2].round(9)) >= {0.0, 1.5}
    assert 2.25 in points(*exact, "--add-param", "2.25")[:, 2]
    assert len(points(*exact, "--grid", "0.2")) == pytest.approx(len(plain) / 4, rel=0.05)
    assert len(points(*exact, "--holes", "5,1")) < len(plain) - 200
    assert np.mean(points(*exact, "--outliers", "0.2") != plain) == pytest.approx(0.2 / 3, abs=0.01)
    seeds = [points("--type", "bridge", "--seed", seed) for seed in ("0", "0", "1")]
    assert np.array_equal(seeds[0], seeds[1])
    assert not np.array_equal(seeds[0], seeds[2])
    salted = points("--type", "bridge", "--salt-pepper", "0.9")
    assert salted[:, 2].std() > seeds[0][:, 2].std()
    assert not np.array_equal(points("--type", "bridge", "--noise", "slam"), seeds[0])
    house = ("--type", "house-storeys", "--sigma", "0,0", "--salt-pepper", "0")
    assert len(points(*house, "--all-points")) > len(points(*house, "--range", "2"))
    assert len(points(*house, "--field-of-view", "40")) < len(points(*house))
    points(*house, "--route-height", "0.7")
    route = gather(mlscli.open_recording("flight.txt").keyframes()).route
    assert route[:, 3].max() == pytest.approx(2.4 + 0.7)
    assert len(points("--type", "village", "--size", "1")) < 6000


def test_options_reach_the_truth() -> None:
    synth("--type", "bridge", "--cell-size", "0.3", "--gap-size", "9")
    true = read_map("bridge.truth.npz")
    assert (true.cell_size, true.gap_size, true.thickness) == (0.3, 9.0, 0.3)
    assert true.size == 400
    synth("--type", "bridge", "--thickness", "0.01", "--overwrite")
    assert (read_map("bridge.truth.npz").depth > 0).any()


def test_a_scene_of_ones_own_is_flown_over() -> None:
    Path("shed.yaml").write_text("- horizontal: {position: [0, 0, 0], size: [3, 3]}\n")
    assert synth("--scene", "shed.yaml").exit_code == 0
    assert read_map("shed.truth.npz").size == 400
    assert len(points("--scene", "shed.yaml")) == 900


def test_clouds_in_the_sensor_frame_are_for_bags() -> None:
    assert synth("--type", "1", "-o", "a.bag", "--sensor-frame").exit_code == 0
    assert mlscli.open_recording("a.bag", frame="camera").frame_id == "camera"
    assert "--sensor-frame" in str(complaint("--type", "1", "-o", "a.txt", "--sensor-frame"))


@pytest.mark.parametrize(
    ("arguments", "kind", "named"),
    [
        ((), UsageError, "neither of --type and --scene, expected one, or --cloud"),
        (("--type", "1", "--scene", "a.yaml"), UsageError, "both of --type and --scene"),
        (("--type", "brigde"), UsageError, "did you mean bridge"),
        (("--scene", "a.yaml"), InputError, "a.yaml"),
        (("--scene", "bad.yaml"), ConfigError, "bad.yaml:1:"),
        (("--scene", "bad.yaml", "--size", "3"), UsageError, "--size 3"),
        (("--type", "1", "-o", "a.ply"), UsageError, "a.ply: does not end in .txt"),
        (("--type", "1", "--holes", "1.5,2"), UsageError, "--holes 1.5,2"),
        (("--type", "1", "--cell-size", "0"), UsageError, "cell size is 0"),
        (("--type", "1", "--grid", "-1"), UsageError, "--grid -1"),
        (("--type", "1", "-o", "no/a.txt"), OutputError, "no does not exist"),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_written(
    arguments: tuple[str, ...], kind: type[MlsError], named: str, folder: Path
) -> None:
    Path("bad.yaml").write_text("- cube: {}\n")
    error = complaint(*arguments)
    assert isinstance(error, kind)
    assert named in with_options(str(error))
    assert [file.name for file in folder.iterdir()] == ["bad.yaml"]


def test_neither_recording_nor_truth_is_replaced_unasked(folder: Path) -> None:
    for existing in ("bridge.txt", "bridge.truth.npz"):
        (folder / existing).write_text("mine")
        assert isinstance(complaint("--type", "1"), OutputError)
        assert [file.name for file in folder.iterdir()] == [existing]
        assert (folder / existing).read_text() == "mine"
        (folder / existing).unlink()
    for _ in range(2):
        assert synth("--type", "1", "-o", "a", "--overwrite").exit_code == 0


# --- over a scan ---


@pytest.fixture
def scan(folder: Path) -> Path:
    """Return a file with the scan of a table, its corner at 100, 200, with y up."""
    ground, top = level(1500, (100, 110), (200, 208), 5.0), level(300, (103, 107), (202, 206), 7.0)
    x, y, z = np.concatenate((ground, top)).T
    path = folder / "table.txt"
    np.savetxt(path, np.column_stack((x, z, -y)), fmt="%.17g")
    return path


TABLE = ("--cloud", "table.txt", "--up", "y")
EXACT = ("--sigma", "0,0", "--salt-pepper", "0")


@pytest.mark.usefixtures("scan")
def test_a_scan_is_flown_over_and_no_truth_is_written(folder: Path) -> None:
    result = synth(*TABLE, *EXACT, "--features", "100000")
    assert result.exit_code == 0, result.output
    assert {file.name for file in folder.iterdir()} == {"table.txt", "table.flight.txt"}
    flight = gather(mlscli.open_recording("table.flight.txt").keyframes())
    whole = gather(mlscli.open_recording("table.txt", up="y").keyframes()).points.xyz
    found = {tuple(point) for point in flight.points.xyz.tolist()}
    assert found <= {tuple(point) for point in whole.tolist()}
    # All of the table, and all of the ground, for lanes look under it from aside.
    assert sum(z == 7 for _, _, z in found) == 300
    assert sum(z == 5 for _, _, z in found) > 1470
    route = flight.route[:, 1:]
    assert route[:, 2].min() > 7
    line = result.stdout
    assert line.startswith(f"table.flight.txt: {len(found):,} points in {len(route):,} keyframes")
    assert "over a scan of 1,800, " in line
    assert line.endswith("the truth is the scan, table.txt\n")


@pytest.mark.usefixtures("scan")
@pytest.mark.parametrize("output", ["a.txt", "a.csv", "a.bag", "a.mcap", "a"])
def test_flights_over_scans_read_back_from_every_format(output: str) -> None:
    options = (*TABLE, "--features", "50", "--noise", "slam")
    expected = points(*options)
    assert synth(*options, "-o", output).exit_code == 0
    back = gather(mlscli.open_recording(output).keyframes())
    assert np.array_equal(back.points.xyz, expected)
    assert np.isfinite(back.route).all()


@pytest.mark.usefixtures("scan")
def test_json_says_what_was_flown_over() -> None:
    account = json.loads(synth(*TABLE, "--json").stdout)
    flight = gather(mlscli.open_recording("table.flight.txt").keyframes())
    assert account.pop("seconds") > 0
    assert account.pop("scan_seen") > 0.95
    assert 2 < account.pop("median_range") < 6
    assert account == {
        "recording": "table.flight.txt",
        "cloud": ["table.txt"],
        "points": flight.points.size,
        "keyframes": len(flight.route),
        "scan_points": 1800,
        "lost": [],
    }


@pytest.mark.usefixtures("scan")
def test_options_reach_the_flight_over_a_scan() -> None:
    few = points(*TABLE, *EXACT, "--features", "50")
    assert len(few) < len(points(*TABLE, *EXACT, "--features", "100"))
    assert np.array_equal(points(*TABLE, *EXACT, "--features", "50", "--seed", "0"), few)
    assert not np.array_equal(points(*TABLE, *EXACT, "--features", "50", "--seed", "1"), few)
    assert len(points(*TABLE, *EXACT, "--all-points")) == 1800
    everything = points(*TABLE, *EXACT, "--features", "9999")
    assert len(points(*TABLE, *EXACT, "--features", "9999", "--holes", "3,2")) < len(everything)
    assert len(points(*TABLE, *EXACT, "--crop", "100,105,200,208,-99,99")) < 1800 / 1.5
    assert set(points("--cloud", "table.txt", *EXACT)[:, 1]) <= {5.0, 7.0}
    points(*TABLE, "--route-height", "3")
    assert gather(mlscli.open_recording("flight.txt").keyframes()).route[:, 3].max() == 10
    Path("way.yaml").write_text("- {start: [101, 201, 5.5], end: [101, 207, 5.5], tilt: 85}")
    by_hand = (*TABLE, *EXACT, "--legs", "way.yaml", "--range", "20")
    ahead = points(*by_hand)
    route = gather(mlscli.open_recording("flight.txt").keyframes()).route
    assert set(route[:, 3].tolist()) == {5.5}
    assert len(points(*by_hand, "--survey")) > len(ahead)
    # The ray's errors are those asked for at a distance.
    slam = ("--noise", "slam", "--sigma", "0,0.01", "--salt-pepper", "0", "--legs", "way.yaml")
    errors = [
        np.abs(points(*TABLE, *slam, "--range", "20", *more) - ahead).max()
        for more in ((), ("--reference", "1"), ("--reference", "0.5"))
    ]
    assert errors[0] < errors[1] == pytest.approx(errors[2] / 4)


@pytest.mark.usefixtures("scan")
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((*TABLE, "--type", "1"), "--type: belongs to a scene, and --cloud is a scan"),
        ((*TABLE, "--scene", "a.yaml"), "--scene: belongs to a scene"),
        ((*TABLE, "--add-param", "1"), "--add-param: belongs to a scene"),
        ((*TABLE, "--size", "1"), "--size: belongs to a scene"),
        ((*TABLE, "--grid", "0.1"), "--grid: belongs to a scene"),
        ((*TABLE, "--cell-size", "0.15"), "--cell-size: belongs to a scene"),
        ((*TABLE, "--gap-size", "1"), "--gap-size: belongs to a scene"),
        ((*TABLE, "--thickness", "1"), "--thickness: belongs to a scene"),
        ((*TABLE, "--all-points", "--features", "9"), "--features 9: --all-points records every"),
        ((*TABLE, "--features", "0"), "--features 0: expected 1 or more"),
        ((*TABLE, "--reference", "1"), "--reference 1: goes with noise slam"),
        ((*TABLE, "--sensor-frame"), "--sensor-frame: table.flight.txt is text"),
        ((*TABLE, "--range", "0.01", "--no-survey"), "fly a --survey over it"),
        ((*TABLE, "--legs", "no.yaml"), "no.yaml: no such file; --legs takes a route"),
        (("--scene", "house"), "--scene takes a scene in YAML; --type house is one that there is"),
        ((*TABLE, "-o", "table.txt", "--overwrite"), "table.txt: is the source itself"),
        ((*TABLE, "-o", ".", "--overwrite"), ".: holds the source table.txt"),
        ((*TABLE, "--holes", "0.5,1"), "--holes 0.5,1"),
        (("--cloud", "no.ply"), "no.ply"),
        (("--cloud", "table.txt", "--up", "u"), "--up u: expected one of"),
        (("--type", "1", "--features", "9"), "--features: goes with --cloud SCAN"),
        (("--type", "1", "--legs", "a.yaml"), "--legs: goes with --cloud SCAN"),
        (("--type", "1", "--no-survey"), "--no-survey: goes with --cloud SCAN"),
        (("--type", "1", "--up", "y"), "--up: goes with --cloud SCAN"),
        (("--type", "1", "--crop", "0,1,0,1,0,1"), "--crop: goes with --cloud SCAN"),
    ],
)
def test_what_does_not_go_together_is_told_before_anything_is_written(
    arguments: tuple[str, ...], named: str, folder: Path
) -> None:
    error = complaint(*arguments)
    assert isinstance(error, MlsError)
    assert named in with_options(str(error))
    assert [file.name for file in folder.iterdir()] == ["table.txt"]


def test_a_scan_that_is_broken_is_flown_over_as_far_as_it_goes(scan: Path, folder: Path) -> None:
    x, y, z = np.loadtxt(scan).T
    records = np.column_stack((x, y, z)).astype("<f4").tobytes()
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1800\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    (folder / "cut.ply").write_bytes(head.encode() + records[:-24])
    made = mls("synth", "--cloud", "cut.ply", "--up", "y", "--json", cwd=folder)
    assert made.returncode == 3
    assert "cut.ply" in made.stderr
    account = json.loads(made.stdout)
    assert account["scan_points"] == 1798
    assert len(account["lost"]) == 1


def test_the_program_makes_a_flight_that_it_can_build(folder: Path) -> None:
    made = mls("synth", "--type", "house", cwd=folder)
    assert (made.returncode, made.stderr) == (0, "")
    built = mls("build", "house.txt", cwd=folder)
    assert built.returncode == 0
    assert read_map(folder / "house.npz").meta["points"]["read"] > 4000
    failed = mls("synth", "--type", "house", cwd=folder)
    assert failed.returncode == 1
    assert failed.stderr.count("\n") == 1
    assert "house.txt: exists already" in failed.stderr
