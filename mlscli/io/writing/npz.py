"""Maps as `.npz` files, format version 3: one array per column, no pickles.

Version 1 had no array `moved`. It is read as well: which patches were moved follows from the rest.
Version 2 had no `noise`, which then is not known. Arrays of free space, with names that begin with
``free_``, are there only if they were asked for; so are those of kept points, ``points_``.

The arrays are stored without compression, each with a fixed date, so that equal maps from equal
sources make equal files. A reader trusts nothing: names, types, shapes and sizes are checked
before memory is allocated for an array, and the invariants of the map afterwards.
"""

from __future__ import annotations

import json
import lzma
import os
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import IO, Any

import numpy as np

from mlscli.errors import InputError, MlsError, expect, expect_path, one_line
from mlscli.io.files import expect_file, open_input
from mlscli.io.unpacking import excess, most_unpacked
from mlscli.io.writing.atomic import atomic_write
from mlscli.keyframes.kept import KeptPoints
from mlscli.maps.columns import COLUMNS
from mlscli.maps.free_space import FREE_COLUMNS, FreeSpace
from mlscli.maps.grid import LENGTHS
from mlscli.maps.stored_map import StoredMap, column_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array
from mlscli.runtime.notices import detail

FORMAT, VERSION = "mls-map", 3
# What earlier versions did not have.
_ADDED = {1: ("moved", "noise"), 2: ("noise",), VERSION: ()}
_EPOCH = (1980, 1, 1, 0, 0, 0)

# What reads the header of an array, by the version of its format.
_HEADERS: dict[Any, Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}

# What reading a member of a damaged, encrypted or oddly compressed archive raises.
_DAMAGED = (ValueError, EOFError, RuntimeError, zlib.error, lzma.LZMAError)


def write_map(
    path: str | os.PathLike[str],
    surface: SurfaceMap | StoredMap,
    *,
    points: KeptPoints | None = None,
    overwrite: bool = False,
) -> None:
    """Write a map, whole or not at all; a `StoredMap` is written part by part.

    Parameters
    ----------
    path
    surface : SurfaceMap or StoredMap
    points : KeptPoints, optional
        The points of which it was made, to be kept beside it.
    overwrite : bool

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    expect(surface, (SurfaceMap, StoredMap), "surface", "a map (SurfaceMap)")
    expect(points, (KeptPoints, NoneType), "points", "points kept beside a map (KeptPoints)")
    with (
        atomic_write(path, overwrite=overwrite) as stream,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive,
    ):

        def write(name: str, value: object) -> None:
            with array_member(archive, name) as member:
                np.lib.format.write_array(member, np.asanyarray(value), allow_pickle=False)

        write("format", FORMAT)
        write("version", VERSION)
        for name in LENGTHS:
            write(name, getattr(surface.grid, name))
        for name, dtype in COLUMNS.items():
            with array_member(archive, name) as member:
                _write_column(member, dtype, surface.size, column_of(surface, name))
        write("frame_id", surface.grid.frame_id)
        write("route", surface.route)
        write("meta", json.dumps(surface.meta, ensure_ascii=False, allow_nan=False))
        for name, column in surface.free.columns.items() if surface.free is not None else ():
            write(f"free_{name}", column)
        if points is not None:
            write("points_xyz", points.xyz)
            write("points_sizes", points.sizes)
            write("points_account", json.dumps([points.read, dict(points.dropped)]))


def array_member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    """Open a new array of an .npz file for writing; the same arrays give the same bytes."""
    return archive.open(zipfile.ZipInfo(f"{name}.npy", _EPOCH), "w", force_zip64=True)


def _write_column(
    member: IO[bytes], dtype: np.dtype[Any], size: int, parts: Iterable[Array]
) -> None:
    """Write an array (size,) from its parts, with the bytes that numpy would write."""
    described = {
        "descr": np.lib.format.dtype_to_descr(dtype),
        "fortran_order": False,
        "shape": (size,),
    }
    np.lib.format.write_array_header_1_0(member, described)
    for part in parts:
        member.write(np.ascontiguousarray(part).data)


def read_map(path: str | os.PathLike[str]) -> SurfaceMap:
    """Read a map and check it.

    Raises
    ------
    InputError
        With the name of the file and the first fault: what is missing, or has the wrong type,
        shape, order or range.
    """
    expect_path(path, "path", "a map")
    source = Path(path)
    expect_file(source)
    detail(f"{source}: is read as a map")
    with _reading(source), open_input(source) as file, zipfile.ZipFile(file) as archive:
        members = _Members(archive)
        if (kind := members.text("format")) != FORMAT:
            raise InputError(f"format: is {kind!r}; it must be {FORMAT!r}")
        version = int(members.array("version", None, ()))
        if version not in _ADDED:
            raise InputError(
                f"version: is {version}; this program reads versions {min(_ADDED)} to {VERSION}"
            )
        arrays: dict[str, Any] = {
            name: float(members.array(name, np.float64, ())) for name in LENGTHS
        }
        patches = members.shape("ix")
        arrays |= {
            name: np.full(patches[:1], np.nan if dtype.kind == "f" else 0, dtype)
            if name in _ADDED[version]
            else members.array(name, dtype, patches[:1])
            for name, dtype in COLUMNS.items()
        }
        route = members.array("route", np.float64, (*members.shape("route")[:1], 4))
        frame_id = members.text("frame_id")
        meta = json.loads(members.text("meta"))
        if not isinstance(meta, dict):
            raise InputError(f"meta: holds a JSON {type(meta).__name__}; it must be an object")
        surface = SurfaceMap(
            **arrays, frame_id=frame_id, route=route, meta=meta, free=_free_space(members)
        )
        if "moved" in _ADDED[version]:
            surface = replace(surface, moved=surface.beyond_points().astype(np.uint8))
        surface.check()
    return surface


def read_points(path: str | os.PathLike[str]) -> KeptPoints | None:
    """Read the points that were kept beside a map; None where there are none.

    Raises
    ------
    InputError
        As `read_map`; also where they are not those of the map's keyframes.
    """
    source = Path(path)
    with _reading(source), open_input(source) as file, zipfile.ZipFile(file) as archive:
        members = _Members(archive)
        if not members.has("points_xyz"):
            return None
        keyframes = members.shape("route")[:1]
        sizes: Any = members.array("points_sizes", np.int64, keyframes)
        xyz: Any = members.array("points_xyz", np.float64, (*members.shape("points_xyz")[:1], 3))
        # In whole numbers of Python, which do not overflow.
        if (sizes < 0).any() or sum(sizes.tolist()) != len(xyz):
            raise InputError(
                f"points_sizes: holds {sum(sizes.tolist()):,} points; points_xyz has {len(xyz):,}"
            )
        try:
            read, dropped = json.loads(members.text("points_account"))
            dropped = {str(reason): int(count) for reason, count in dropped.items()}
            return KeptPoints(xyz, sizes, int(read), dropped)
        except (TypeError, AttributeError):
            raise InputError("points_account: holds no counts of points") from None


def _free_space(members: _Members) -> FreeSpace | None:
    """Return the free space that a map holds; None where it has none of these arrays."""
    if not any(members.has(f"free_{name}") for name in FREE_COLUMNS):
        return None
    cells, voxels = ((*members.shape(f"free_{name}"), 0)[0] for name in ("ix", "iz"))
    sizes = {"iz": voxels, "lines": voxels, "start": cells + 1}
    columns: dict[str, Any] = {
        name: members.array(f"free_{name}", dtype, (sizes.get(name, cells),))
        for name, dtype in FREE_COLUMNS.items()
    }
    return FreeSpace(**columns)


def is_map(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is marked as a map; False where it cannot be read."""
    try:
        with open_input(path) as file, zipfile.ZipFile(file) as archive:
            return _Members(archive).text("format") == FORMAT
    except (*_DAMAGED, OSError, zipfile.BadZipFile, MlsError):
        return False


@contextmanager
def _reading(source: Path) -> Iterator[None]:
    """Turn errors of reading a file into an `InputError` of one line that names it."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except FileNotFoundError:
        raise InputError(f"{source}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{source}: is a folder; a map is a .npz file") from None
    except zipfile.BadZipFile as error:
        why = one_line(error)
        raise InputError(f"{source}: is no map (.npz), or a damaged one: {why}") from None
    except _DAMAGED as error:
        raise InputError(f"{source}: is a damaged map: {one_line(error)}") from None
    except OSError as error:
        raise InputError(f"{source}: cannot be read: {error.strerror or error}") from None


class _Members:
    """The arrays of an archive, each checked before it is read."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        entries = archive.infolist()
        self._packed = sum(entry.compress_size for entry in entries)
        self._unpacked = sum(entry.file_size for entry in entries)

    def _header(self, name: str) -> tuple[zipfile.ZipInfo, tuple[int, ...], np.dtype[Any]]:
        try:
            entry = self._archive.getinfo(f"{name}.npy")
        except KeyError:
            raise InputError(f"{name}: is missing; a map holds this array") from None
        with self._archive.open(entry) as member:
            version = np.lib.format.read_magic(member)
            if version not in _HEADERS:
                raise InputError(f"{name}: has a header of version {version}; 1.0 is expected")
            try:
                shape, _, dtype = _HEADERS[version](member)
            except _DAMAGED:
                raise
            except Exception as error:
                # A header is parsed as Python, which fails in as many ways as there are of writing.
                raise InputError(f"{name}: has a damaged header: {one_line(error)}") from None
            begin = member.tell()
        size = begin + dtype.itemsize * int(np.prod([int(side) for side in shape], dtype=object))
        if self._unpacked > most_unpacked(self._packed):
            raise InputError(excess(self._packed))
        if dtype.hasobject or entry.file_size != size:
            raise InputError(
                f"{name}: declares {dtype} {shape} ({size} bytes) and holds "
                f"{entry.file_size} bytes, {entry.compress_size} in the file"
            )
        return entry, shape, dtype

    def has(self, name: str) -> bool:
        return f"{name}.npy" in self._archive.namelist()

    def shape(self, name: str) -> tuple[int, ...]:
        return self._header(name)[1]

    def array(self, name: str, dtype: Any, shape: tuple[int, ...]) -> Array:
        """Return an array, checked to be of this dtype (None: any integer) and this shape."""
        entry, found, kind = self._header(name)
        right = np.issubdtype(kind, np.integer) if dtype is None else kind == dtype
        if not right:
            expected = "an integer" if dtype is None else np.dtype(dtype).name
            raise InputError(f"{name}: has dtype {kind}; it must be {expected}")
        if found != shape:
            raise InputError(f"{name}: has shape {found}; it must be {shape}")
        with self._archive.open(entry) as member:
            array: Array = np.lib.format.read_array(member, allow_pickle=False)
        return array

    def text(self, name: str) -> str:
        entry, shape, dtype = self._header(name)
        if dtype.kind != "U" or shape != ():
            raise InputError(f"{name}: has dtype {dtype} and shape {shape}; it must be a string")
        with self._archive.open(entry) as member:
            return str(np.lib.format.read_array(member, allow_pickle=False))
