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
        ((), UsageError, "neither of --type and --scene"),
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
