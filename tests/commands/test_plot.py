"""``mls plot``: pictures that can be read back, and what is refused.

Ways to pass without being right: an empty picture, so its colours are looked for.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from click.testing import CliRunner, Result

from mlscli.commands.plot import command
from mlscli.errors import OutputError, UsageError, with_options
from mlscli.io.writing.npz import write_map
from mlscli.mesh.colours import ARTIFICIAL_RED, ROUTE_GREEN
from tests.helpers.meshes import house
from tests.helpers.program import mls


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_map("house.npz", house())
    write_map("bare.npz", house().take(house().origin == 0))
    return tmp_path


def plot(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def pixels(path: Path, colour: tuple[int, int, int]) -> int:
    image = np.rint(matplotlib.image.imread(path)[:, :, :3] * 255)
    return int(np.count_nonzero((np.abs(image - colour) <= 8).all(axis=2)))


def test_the_picture_is_named_after_the_map_and_shows_red_and_the_green_route(folder: Path) -> None:
    result = plot("house.npz")
    assert result.stdout == "house.png\n", result.exception
    assert pixels(folder / "house.png", ROUTE_GREEN) > 100


def test_the_red_can_be_left_out(folder: Path) -> None:
    plot("house.npz", "-o", "all.png", "--section", "-1,0.15,2,0.15")
    plot("house.npz", "-o", "without.png", "--section", "-1,0.15,2,0.15", "--no-artificial")
    light = tuple(round(0.55 * c + 0.45 * 255) for c in ARTIFICIAL_RED)
    assert pixels(folder / "all.png", (light[0], light[1], light[2])) > 100
    assert pixels(folder / "without.png", (light[0], light[1], light[2])) == 0


@pytest.mark.parametrize(
    "options",
    [
        ["--level", "1"],
        ["--section", "-1,0.5,2,0.5"],
        ["--compare", "bare.npz"],
        *(["--color", name] for name in ("origin", "variance", "count", "region", "time")),
    ],
)
def test_every_option_makes_a_picture(options: list[str], folder: Path) -> None:
    result = plot("house.npz", *options)
    assert result.exit_code == 0, result.exception
    image = matplotlib.image.imread(folder / "house.png")
    assert len(np.unique(image[:, :, :3].reshape(-1, 3), axis=0)) > 10


@pytest.mark.parametrize(("ending", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_the_ending_names_the_format(ending: str, begins: bytes, folder: Path) -> None:
    assert plot("house.npz", "-o", f"a.{ending}").exit_code == 0
    assert (folder / f"a.{ending}").read_bytes().startswith(begins)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--level", "9"], "--level 9: no cell has as many; this map has up to 3"),
        (["--level", "1", "--section", "0,0,1,1"], "--level and --section: do not go together"),
        (["--section", "1,2,3"], "--section 1,2,3: expected four numbers"),
        (["-o", "a.bmp"], "a.bmp: ends in '.bmp'; expected one of .png, .svg, .pdf"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_wrong_words_are_refused(options: list[str], said: str) -> None:
    error = plot("house.npz", *options).exception
    assert isinstance(error, UsageError)
    assert said in with_options(str(error))


@pytest.mark.usefixtures("folder")
def test_an_existing_picture_is_replaced_only_when_told() -> None:
    Path("house.png").write_bytes(b"mine")
    assert isinstance(plot("house.npz").exception, OutputError)
    assert Path("house.png").read_bytes() == b"mine"
    assert plot("house.npz", "--overwrite").exit_code == 0


def test_the_command_runs_as_users_call_it(folder: Path) -> None:
    done = mls("plot", "house.npz", cwd=folder)
    assert (done.returncode, done.stdout) == (0, "house.png\n"), done.stderr
