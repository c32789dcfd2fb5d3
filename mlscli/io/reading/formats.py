"""The formats that can be read, recognised by content, not by name."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError, expect
from mlscli.io.clouds.pointarray import PointArray
from mlscli.io.containers.ros2metadata import STORAGE
from mlscli.io.files import open_input
from mlscli.io.ros import METADATA_FILE
from mlscli.io.source import Reading, Source
from mlscli.runtime.arrays import Array
from mlscli.runtime.notices import detail

_HEAD = 1 << 16
_PCD = re.compile(rb"(?:[ \t]*(?:#[^\n]*)?\r?\n)*(?:# ?\.PCD|VERSION 0?\.|FIELDS )")
_HTML = re.compile(rb"\s*<(?:!doctype html|html)\b", re.IGNORECASE)
_GRID = re.compile(rb"\s*(?:ncols\s+\d+\s+nrows|nrows\s+\d+\s+ncols)\s+\d+\s", re.IGNORECASE)
# Comments, libraries and names, and then vertices, with more than these behind them.
_OBJ = re.compile(
    rb"(?:[ \t]*(?:#[^\n]*|mtllib[^\n]*|[og]\b[^\n]*)?\r?\n)*"
    rb"v[ \t]+[-+.0-9][^\0]*\n(?:f|vn|vt)[ \t]"
)
# What vertices have besides a place, the keyword, and counts behind it or in the next line.
_OFF = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(?:ST)?C?N?4?n?OFF(?:\s+BINARY|(?:\s|#[^\n]*\n)*\d)")
_STL = re.compile(rb"\s*solid\b[^\n]*\n\s*facet\s+normal\s")
_NVM = re.compile(rb"\s*NVM_V\d")
# Not a text of rows in brackets.
_JSON = re.compile(rb"\s*(?:\{|\[(?![^\]\n]*\][ \t]*\r?\n\s*\[))")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")


def open_source(path: Path, reading: Reading | None = None) -> Source:
    """Recognise the format of a file or folder by its content and open it.

    Parameters
    ----------
    path : Path
    reading : Reading, optional
        The user's options for reading it; the defaults where not given.

    Raises
    ------
    InputError
        The path is missing, unreadable, broken, or of a format that cannot be read.
    """
    head = _head(path)
    try:
        format_ = next((each for each in _by_content() if each.holds(path, head)), None)
        found = f"is {format_.name}, which cannot be read" if format_ else _content(path, head)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if format_ is None or format_.open is None:
        raise InputError(f"{path}: {found}; can be read: {readable()}")
    detail(f"{path}: is read as {format_.name}")
    return format_.open(path, reading or Reading())


def open_one(source: str | os.PathLike[str] | Array, reading: Reading) -> Source:
    """Open a file or folder, see `open_source`, or points as an array (N, 3)."""
    expected = "the path of a recording, or points as an array (N, 3)"
    expect(source, (str, os.PathLike, np.ndarray), "sources", expected)
    if isinstance(source, np.ndarray):
        return PointArray(source)
    return open_source(Path(source), reading)


def readable() -> str:
    """Return what can be read, as a list in words."""
    *most, last = [each.listed for each in FORMATS if each.listed]
    return f"{', '.join(most)}, and {last}"


class Format(NamedTuple):
    """A format, and how it is recognised and opened.

    Attributes
    ----------
    name : str
        Its name in messages to the user.
    holds : callable
        Returns for a path and its first bytes whether it is of this format.
    open : callable or None
        Opens a path; None where the format cannot be read.
    listed : str
        How the list of what can be read names it; empty where another entry of the list says it.
    """

    name: str
    holds: Callable[[Path, bytes], bool]
    open: Callable[[Path, Reading], Source] | None = None
    listed: str = ""


def _starting(*magics: bytes) -> Callable[[Path, bytes], bool]:
    return lambda _, head: head.removeprefix(b"\xef\xbb\xbf").startswith(magics)


def _reader(module: str, name: str) -> Callable[[Path, Reading], Source]:
    """Return what opens a file by a class of `mlscli.io.clouds`, imported when it is needed."""

    def open_(path: Path, _: Reading) -> Source:
        opened: Source = getattr(import_module(f"mlscli.io.clouds.{module}"), name)(path)
        return opened

    return open_


def _open_messages(path: Path, reading: Reading) -> Source:
    from mlscli.io.containers.opening import open_container
    from mlscli.io.messages.topic import TopicSource

    # The metadata of a bag stand for their folder.
    container = open_container(path.parent if path.name == METADATA_FILE else path)
    return TopicSource(container, reading.topic, reading.clock)


def _open_text(path: Path, reading: Reading) -> Source:
    from mlscli.io.clouds.text import TextCloud

    return TextCloud(path, reading.columns)


def _open_colmap(path: Path, _: Reading) -> Source:
    from mlscli.io.clouds.colmap import ColmapModel

    models = _colmap_models(path)
    if len(models) > 1:
        raise InputError(
            f"{path}: holds {len(models)} COLMAP models, each in a frame of its own; name one: "
            f"{', '.join(map(str, models[:5]))}{', ...' if len(models) > 5 else ''}"
        )
    return ColmapModel(models[0], _others_beside(path, models[0]))


def _open_opensfm(path: Path, _: Reading) -> Source:
    from mlscli.io.clouds.opensfm import OpenSfmReconstruction

    taken, *others = _reconstructions(path)
    return OpenSfmReconstruction(taken, _not_taken(path, taken, others))


def _is_ros2_folder(path: Path, head: bytes) -> bool:
    """Return whether a path is a folder with what a ROS 2 bag has, or the metadata of one."""
    if not path.is_dir():
        return path.name == METADATA_FILE and b"rosbag2_bagfile_information" in head
    return any(c.name == METADATA_FILE or STORAGE.search(c.name) for c in path.iterdir())


_POINTS = ("points3D.bin", "points3D.txt")
_BESIDE_POINTS = tuple(f"{part}.bin" for part in ("images", "cameras", "frames", "rigs"))


def _colmap_models(path: Path) -> list[Path]:
    """Return the COLMAP models at a path: a file of one, its folder, or those of a project.

    The files are recognised by name, as the binary ones have no magic; a text file also by its
    first comment. A model in a folder itself comes before those in folders of it, those whose
    names are numbers before others, and a project's before those in its folder `sparse`.
    """
    if path.is_file():
        if path.name in _BESIDE_POINTS and _is_model(path.parent):
            return [path.parent]
        by_name = path.name in _POINTS
        return [path] if by_name or _starting(b"# 3D point list")(path, _head(path)) else []
    for folder in (path, path / "sparse"):
        if _is_model(folder):
            return [folder]
        below = _models_below(folder)
        if models := [model for model in below if model.name.isdigit()] or below:
            return models
    return []


def _is_model(folder: Path) -> bool:
    return any((folder / name).is_file() for name in _POINTS)


def _models_below(folder: Path) -> list[Path]:
    return sorted(filter(_is_model, folder.iterdir())) if folder.is_dir() else []


def _others_beside(path: Path, taken: Path) -> list[str]:
    """Return a note of the models at a path that are not taken, if there are any."""
    if path.is_file():
        return []
    there = [m for folder in (path, path / "sparse") for m in (folder, *_models_below(folder))]
    others = [model for model in there if model != taken and _is_model(model)]
    return _not_taken(path, taken, list(dict.fromkeys(others)))


def _not_taken(path: Path, taken: Path, others: Sequence[Path]) -> list[str]:
    """Return a note that says which of the things at a path are not taken, if any."""
    if not others:
        return []
    listed = ", ".join(map(str, others[:5])) + (", ..." if len(others) > 5 else "")
    return [f"{path}: taken is {taken}; not taken: {listed}, in frames of their own"]


def _reconstructions(path: Path) -> list[Path]:
    """Return the OpenSfM reconstructions at a path: a file, or those in a folder or ODM project."""
    if path.is_file():
        head = _head(path).lstrip()
        is_json = head.startswith((b"[", b"{"))
        return [path] if is_json and (b'"cameras"' in head or b'"shots"' in head) else []
    places = (path / "reconstruction.json", path / "opensfm" / "reconstruction.json")
    return [file for file in places if file.is_file()]


def _is_pts(_: Path, head: bytes) -> bool:
    """Return whether a file begins with the count and the first point of a PTS."""
    from mlscli.io.clouds.pts import is_pts

    return is_pts(head)


def _is_ptx(_: Path, head: bytes) -> bool:
    """Return whether a file begins with the header of a PTX: counts, a pose, a matrix."""
    from mlscli.io.clouds.ptx import is_ptx

    return is_ptx(head)


def _is_pcd(_: Path, head: bytes) -> bool:
    """Return whether a file begins like a PCD, after other comments and blank lines or none."""
    return bool(_PCD.match(head.removeprefix(b"\xef\xbb\xbf")))


def _is_text(path: Path, head: bytes) -> bool:
    from mlscli.io.clouds.dialect import encoding_of

    if encoding_of(head) != "utf-8-sig":
        head = head.decode(encoding_of(head), "replace").encode("utf-8", "replace")
    return (
        path.is_file()
        and bool(head.strip(b"\0 \t\r\n"))
        and not _CONTROL.search(head.rstrip(b"\0"))
    )


FORMATS = (
    Format(
        "ROS 1 bag", _starting(b"#ROSBAG V", b"#ROSRECORD"), _open_messages, listed="ROS 1 bags"
    ),
    Format(
        "ROS 2 bag",
        _is_ros2_folder,
        _open_messages,
        listed="ROS 2 bags (a folder with metadata.yaml, .db3, .mcap)",
    ),
    Format("MCAP", _starting(b"\x89MCAP0\r\n"), _open_messages),
    Format("SQLite", _starting(b"SQLite format 3\0"), _open_messages),
    Format("a file of a ROS 2 bag, compressed", _starting(b"\x28\xb5\x2f\xfd"), _open_messages),
    Format("text", _is_text, _open_text, listed="text clouds"),
    Format(
        "PLY",
        _starting(b"ply\n", b"ply\r", b"ply "),
        _reader("plycloud", "PlyCloud"),
        listed=".ply",
    ),
    Format(
        "PCD",
        _is_pcd,
        _reader("pcd", "PcdCloud"),
        listed=".pcd",
    ),
    Format("PTX", _is_ptx, _reader("ptx", "PtxCloud"), listed=".ptx"),
    Format("PTS", _is_pts, _reader("pts", "PtsCloud"), listed=".pts"),
    Format("LAS", _starting(b"LASF"), _reader("las", "LasCloud"), listed=".las and .laz"),
    Format(
        "COLMAP model",
        lambda path, _: bool(_colmap_models(path)),
        _open_colmap,
        listed="COLMAP models",
    ),
    Format("a part of a COLMAP text model", _starting(b"# Image list", b"# Camera list")),
    Format(
        "OpenSfM",
        lambda path, _: bool(_reconstructions(path)),
        _open_opensfm,
        listed="OpenSfM reconstructions",
    ),
    Format(
        "an ESRI grid (gdal_translate -of XYZ makes a text cloud of it)",
        lambda _, head: bool(_GRID.match(head.removeprefix(b"\xef\xbb\xbf"))),
    ),
    Format("a mesh (Wavefront OBJ)", lambda _, head: bool(_OBJ.match(head))),
    Format("a mesh (glTF)", _starting(b"glTF")),
    Format("a mesh (OFF)", lambda _, head: bool(_OFF.match(head))),
    Format("a mesh (STL)", lambda _, head: bool(_STL.match(head))),
    Format("a data set of VTK (ParaView saves it as PLY)", _starting(b"# vtk DataFile")),
    Format(
        "a reconstruction of Bundler (which writes a PLY beside it)", _starting(b"# Bundle file")
    ),
    Format("a reconstruction of VisualSFM (NVM)", lambda _, head: bool(_NVM.match(head))),
    Format("an E57 file (PDAL and CloudCompare make a LAS of it)", _starting(b"ASTM-E57")),
    Format("a BIN of CloudCompare (which saves it as LAS or PLY)", _starting(b"CCB2")),
    Format(
        "a pointer of Git LFS in place of the file (git lfs pull fetches that)",
        _starting(b"version https://git-lfs."),
    ),
    Format("a web page, perhaps what a download ended in", lambda _, head: bool(_HTML.match(head))),
    Format("a JSON file", lambda _, head: bool(_JSON.match(head))),
    Format("a gzip archive", _starting(b"\x1f\x8b")),
    Format("a zip archive or numpy's .npz", _starting(b"PK\x03\x04")),
)
"""The formats there are; the only list of them."""


def _by_content() -> list[Format]:
    """Return the formats in the order in which they are tried: others can be text, too."""
    return sorted(FORMATS, key=lambda each: each.holds is _is_text)


def _head(path: Path) -> bytes:
    """Return the first bytes of a file; none for a folder."""
    try:
        if path.is_dir():
            return b""
        if not path.exists():
            raise InputError(f"{path}: there is no such file or folder")
        if not path.is_file():
            raise InputError(f"{path}: is neither a file nor a folder")
        with open_input(path) as file:
            return file.read(_HEAD)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _content(path: Path, head: bytes) -> str:
    """Say what a file or folder of no known format holds."""
    if path.is_dir():
        names = sorted(child.name for child in path.iterdir())
        listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        lacking = "is no ROS 2 bag, COLMAP model or OpenSfM reconstruction"
        for folder in (path, path / "sparse", path / "sparse" / "0"):
            if (folder / "points3D.ply").is_file():
                lacking += f"; its points may be those of {folder / 'points3D.ply'}: name that file"
        return f"holds {listed}, and {lacking}" if names else "is an empty folder"
    return f"holds {'binary data of no known format' if head.strip() else 'nothing'}"
