"""`mls view`, as a user runs it: which file is written, what is opened, what is refused.

Ways to pass without being right: a page that is named and not written; points that are read
otherwise than the map's were.
"""

from __future__ import annotations

import os
import sys
import tempfile
import webbrowser
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner, Result

from mlscli.commands.view import command
from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.npz import write_map
from tests.helpers.meshes import house
from tests.helpers.program import mls


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds one map, where no browser can be opened."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda _: False)
    write_map("house.npz", house())
    return tmp_path


def view(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def test_a_page_that_is_asked_for_is_written_and_not_opened(folder: Path) -> None:
    result = view("--html", "a.html")
    assert result.exit_code == 0, result.exception
    assert result.stdout.startswith("a.html: ")
    assert " walls" in result.stdout
    page = (folder / "a.html").read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert page.rstrip().endswith("</html>")
    # Nothing is fetched from anywhere.
    assert "://" not in page
    assert "src=" not in page
    for mark in ("/*STYLE*/", "/*SCRIPT*/", "/*HEADER*/", "/*DATA*/"):
        assert mark not in page


def test_without_a_name_the_browser_opens_a_temporary_page(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []

    def open_page(url: str) -> bool:
        opened.append(url)
        return True

    monkeypatch.setattr(webbrowser, "open", open_page)
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    result = view("house.npz")
    assert result.exit_code == 0, result.exception
    (page,) = folder.glob("*/house.html")
    assert opened == [page.as_uri()]


def test_temporary_pages_of_earlier_days_are_removed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setattr(webbrowser, "open", lambda _: True)
    old, new, other = (folder / name for name in ("mls-view-old", "mls-view-new", "else"))
    for kept in (old, new, other):
        kept.mkdir()
        (kept / "house.html").touch()
    for aged in (old, other):
        os.utime(aged, (0, 0))
    (folder / "mls-view-link").symlink_to(other)

    assert view().exit_code == 0

    assert not old.exists()
    assert (new / "house.html").exists()
    assert (other / "house.html").exists()
    assert len(list(folder.glob("mls-view-*/house.html"))) == 3


@pytest.mark.usefixtures("folder")
def test_where_no_browser_opens_the_page_is_named() -> None:
    result = view()
    assert isinstance(result.exception, OutputError)
    page = str(result.exception).partition(":")[0]
    assert Path(page).read_text().startswith("<!DOCTYPE html>")


def test_an_existing_page_is_replaced_only_on_request(folder: Path) -> None:
    (folder / "a.html").write_text("mine")
    refused = view("--html", "a.html")
    assert isinstance(refused.exception, OutputError)
    assert (folder / "a.html").read_text() == "mine"
    assert view("--html", "a.html", "--overwrite").exit_code == 0
    assert (folder / "a.html").read_text() != "mine"


def test_points_are_read_as_those_of_the_map_were(folder: Path) -> None:
    (folder / "cloud.txt").write_text(
        "".join(f"{x} {-y} {-5}\n" for x in range(9) for y in (1, 2, 3))
    )
    options = ("--up", "-z", "-c", "plain", "--set", "map.cell_size=1", "-o", "map.npz")
    assert mls("build", "cloud.txt", *options).returncode == 0
    assert "27 points" in view("map.npz", "--points", "cloud.txt", "--html", "a.html").stdout

    from mlscli.commands.view import _points
    from mlscli.io.writing.npz import read_map

    assert (_points(read_map("map.npz"), ("cloud.txt",))[:, 2] == 5).all()


def test_points_of_another_place_are_told(folder: Path) -> None:
    (folder / "here.txt").write_text("1 1 0\n2 1 0\n900 1 0\n")
    (folder / "elsewhere.txt").write_text("501 1 0\n502 1 0\n503 1 0\n")

    assert view("--points", "here.txt", "--html", "a.html").stderr == ""
    told = view("--points", "elsewhere.txt", "--html", "b.html")
    assert told.exit_code == 0
    assert "elsewhere.txt: none of the points lies where the map is" in told.stderr


@pytest.mark.parametrize("reading", [{"topic": "/cloud"}, {"unheard_of": 1}])
def test_points_that_the_map_s_options_do_not_fit_are_refused_with_these(
    folder: Path, reading: dict[str, Any]
) -> None:
    (folder / "cloud.txt").write_text("1 2 3\n")
    write_map("other.npz", replace(house(), meta={"reading": reading}))
    error = view("other.npz", "--points", "cloud.txt", "--html", "a.html").exception
    assert isinstance(error, UsageError)
    assert str(error).startswith("--points: read as the map's recording was (")
    assert next(iter(reading)) in str(error)
    assert not (folder / "a.html").exists()


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("options", [("--html", "a.html"), ("--points", "house.npz")])
def test_a_window_shows_the_map_alone(options: tuple[str, str]) -> None:
    assert isinstance(view("--window", *options).exception, UsageError)


def test_without_a_display_the_window_is_refused_in_one_line(folder: Path) -> None:
    done = mls(
        "view", "house.npz", "--window", cwd=folder, env={"DISPLAY": "", "WAYLAND_DISPLAY": ""}
    )
    assert done.returncode == 1
    assert done.stderr.startswith("mls: --window: there is no display")
    assert done.stderr.count("\n") == 1


@pytest.mark.usefixtures("folder")
def test_without_open3d_the_window_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setitem(sys.modules, "open3d", None)
    error = view("--window").exception
    assert isinstance(error, OutputError)
    assert "--window: Open3D cannot be loaded" in str(error)
    assert "pip install 'mlscli[window]'; leave out --window" in str(error)


@pytest.mark.usefixtures("folder")
def test_a_window_is_given_the_whole_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    from mlscli.mesh import build_mesh
    from mlscli.view import window
    from tests.helpers.meshes import open3d

    package = open3d()
    shown: list[Any] = []
    front: list[float] = []
    up: list[float] = []

    class Window:
        """Keeps what it is given, as a window without a screen."""

        def create_window(self, window_name: str, width: int, height: int) -> bool:
            assert window_name == "house.npz"
            assert 0 < height < width
            return True

        def get_view_control(self) -> SimpleNamespace:
            return SimpleNamespace(set_front=front.extend, set_up=up.extend)

        def get_render_option(self) -> SimpleNamespace:
            return SimpleNamespace()

        def add_geometry(self, shape: Any) -> None:
            shown.append(shape)

        def run(self) -> None:
            shown.append("run")

        def destroy_window(self) -> None:
            shown.append("closed")

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(package.visualization, "Visualizer", Window)
    window.show(house(), "house.npz")
    faces, lines, *rest = shown
    mesh = build_mesh(house())
    assert len(faces.triangles) == len(mesh.triangles)
    assert len(lines.lines) == len(mesh.lines)
    assert rest == ["run", "closed"]
    # One looks down at what stands upright.
    assert front[2] > 0
    assert up == [0, 0, 1]
