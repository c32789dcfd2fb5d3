"""Map files: what is written is read back, and what is damaged is named.

How one could cheat: compare with `==` alone, which leaves out route and meta; damage only the
container, never an array.
"""

from __future__ import annotations

import io
import zipfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, OutputError
from mlscli.io import unpacking
from mlscli.io.writing.npz import is_map, read_map, write_map
from mlscli.maps.columns import COLUMNS
from mlscli.maps.free_space import FREE_COLUMNS, FreeSpace
from mlscli.maps.stored_map import StoredMap
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.scratch import Scratch
from tests.helpers.broken import allocating_less_than
from tests.helpers.lines import free_space_of
from tests.helpers.maps import random_map

ARRAYS = ["format", "version", "cell_size", "gap_size", "thickness", *COLUMNS]
ARRAYS += ["frame_id", "route", "meta"]


@pytest.fixture
def surface() -> SurfaceMap:
    surface = random_map(np.random.default_rng(4), fill=0.9)
    assert surface.size > 50
    surface.meta["sources"] = ["Überflug.bag"]
    return surface


@pytest.fixture
def written(surface: SurfaceMap, tmp_path: Path) -> Path:
    path = tmp_path / "flight.npz"
    write_map(path, surface)
    return path


def rewrite(path: Path, **changed: Any) -> None:
    """Write the arrays again with numpy's own writer, some of them changed or (None) left out."""
    with np.load(path) as arrays:
        kept = dict(arrays) | changed
    np.savez(path, **{name: array for name, array in kept.items() if array is not None})


def test_a_map_is_read_back_as_it_was_written(surface: SurfaceMap, written: Path) -> None:
    back = read_map(written)
    assert back == surface
    assert back.meta == surface.meta
    assert back.route.tobytes() == surface.route.tobytes()


def test_numpy_reads_the_file_without_pickles(surface: SurfaceMap, written: Path) -> None:
    with np.load(written, allow_pickle=False) as arrays:
        assert sorted(arrays) == sorted(ARRAYS)
        assert str(arrays["format"]) == "mls-map"
        assert int(arrays["version"]) == 3
        for name, dtype in COLUMNS.items():
            assert arrays[name].dtype == dtype
            np.testing.assert_array_equal(arrays[name], getattr(surface, name))


def test_what_numpy_wrote_is_read(surface: SurfaceMap, written: Path) -> None:
    rewrite(written)
    assert read_map(written) == surface
    with np.load(written) as arrays:
        np.savez_compressed(written, **dict(arrays))
    assert read_map(written) == surface


def test_equal_maps_make_equal_files(surface: SurfaceMap, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_map(tmp_path / name, surface)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_map_on_disk_is_written_part_by_part_as_at_once(
    surface: SurfaceMap, written: Path, tmp_path: Path
) -> None:
    with Scratch() as scratch:
        stored = StoredMap(surface.grid, [], surface.route, surface.meta)
        for first, last in ((None, 1), (2, 2), (3, None)):
            stored.put(surface.crop(min_x=first, max_x=last), scratch)
        assert stored.size == surface.size
        write_map(tmp_path / "stored.npz", stored)
    assert (tmp_path / "stored.npz").read_bytes() == written.read_bytes()


@pytest.mark.parametrize("name", ARRAYS)
def test_a_missing_array_is_named(written: Path, name: str) -> None:
    rewrite(written, **{name: None})
    with pytest.raises(InputError, match=rf"flight\.npz: {name}: is missing"):
        read_map(written)


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_another_type_is_named(written: Path, name: str) -> None:
    rewrite(written, **{name: np.array([b"x"])})
    with pytest.raises(InputError, match=rf"flight\.npz: {name}: ") as caught:
        read_map(written)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", COLUMNS)
def test_a_column_that_is_too_short_is_named(written: Path, name: str) -> None:
    with np.load(written) as arrays:
        short = arrays[name][:-1]
    rewrite(written, **{name: short})
    with pytest.raises(InputError, match="has shape"):
        read_map(written)


def test_pickled_objects_are_refused(written: Path) -> None:
    rewrite(written, meta=np.array({"a": 1}, dtype=object))
    with pytest.raises(InputError, match="meta"):
        read_map(written)


def claim_size(path: Path, name: str, dtype: str) -> None:
    """Have an array declare a size that no file has."""
    header = io.BytesIO()
    claimed = {"descr": dtype, "fortran_order": False, "shape": (10**15,)}
    np.lib.format.write_array_header_1_0(header, claimed)
    with np.load(path) as arrays:
        kept = dict(arrays)
    with zipfile.ZipFile(path, "w") as archive:
        for each, array in kept.items():
            with archive.open(f"{each}.npy", "w") as member:
                if each == name:
                    member.write(header.getvalue())
                else:
                    np.lib.format.write_array(member, array)


@pytest.mark.parametrize("fault", ["['", "(" * 300, "{'descr': {}}", "{'descr': 1, 'shape': ()}"])
def test_a_header_that_cannot_be_parsed_is_named(written: Path, fault: str) -> None:
    with np.load(written) as arrays:
        kept = dict(arrays)
    with zipfile.ZipFile(written, "w") as archive:
        for each, array in kept.items():
            with archive.open(f"{each}.npy", "w") as member:
                if each == "ix":
                    header = fault.encode() + b"\n"
                    member.write(b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header)
                else:
                    np.lib.format.write_array(member, array)
    with pytest.raises(InputError, match=r"flight\.npz: .*") as caught:
        read_map(written)
    assert "\n" not in str(caught.value)
    assert is_map(written)


@pytest.mark.parametrize("side", [0.0, -0.5, 1e-300, 1e300, np.inf, np.nan])
def test_a_side_that_no_cell_has_is_named(written: Path, side: float) -> None:
    rewrite(written, cell_size=np.array(side))
    with pytest.raises(
        InputError, match=r"flight\.npz: cell_size: is .*; it must be from 1e-09 to"
    ):
        read_map(written)


@pytest.mark.parametrize("name", ["gap_size", "thickness"])
@pytest.mark.parametrize("length", [-0.5, 1e300, np.inf, np.nan])
def test_a_length_that_no_map_is_built_with_is_named(
    written: Path, name: str, length: float
) -> None:
    rewrite(written, **{name: np.array(length)})
    with pytest.raises(InputError, match=rf"{name}: is .*; it must be from 0 to 2,147,483,647"):
        read_map(written)


def test_a_size_that_is_only_claimed_is_refused_before_memory_is_given(written: Path) -> None:
    claim_size(written, "ix", "<f8")
    with pytest.raises(InputError, match="ix: declares"):
        read_map(written)


def test_a_map_that_unpacks_to_gigabytes_is_refused_before_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "ALWAYS", 1 << 20)
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, format=np.array("mls-map"), ix=np.zeros(9_000_000, dtype=np.uint8))
    with allocating_less_than(1_000_000), pytest.raises(InputError) as caught:
        read_map(path)
    assert "unpack to more than" in str(caught.value)


def test_a_map_cut_anywhere_is_refused_in_one_line(written: Path) -> None:
    data = written.read_bytes()
    for size in np.linspace(0, len(data) - 1, 60).astype(int):
        written.write_bytes(data[:size])
        with pytest.raises(InputError) as caught:
            read_map(written)
        assert "\n" not in str(caught.value)


def test_a_name_of_30_000_bytes_is_not_said_in_full(written: Path) -> None:
    # The length of a member's name in its own header, not in the directory.
    content = bytearray(written.read_bytes())
    at = content.index(b"PK\x03\x04", 4)
    content[at + 26 : at + 28] = (30_000).to_bytes(2, "little")
    written.write_bytes(content + bytes(60_000))
    with pytest.raises(InputError) as refused:
        read_map(written)
    assert len(str(refused.value)) < 1000


def test_a_map_with_flipped_bits_is_refused_or_the_same_but_never_another(
    surface: SurfaceMap, written: Path
) -> None:
    data = written.read_bytes()
    rng = np.random.default_rng(2)
    for at in rng.integers(0, len(data), 200):
        damaged = bytearray(data)
        damaged[at] ^= 1 << int(rng.integers(8))
        written.write_bytes(damaged)
        back = None
        with suppress(InputError):
            back = read_map(written)
        assert back is None or back == surface


def test_a_map_is_told_by_content(written: Path, tmp_path: Path) -> None:
    assert is_map(written)
    other = tmp_path / "other.npz"
    np.savez(other, x=np.zeros(3))
    assert not is_map(other)
    assert not is_map(tmp_path / "none.npz")
    text = tmp_path / "text.npz"
    text.write_text("0 0 0\n")
    assert not is_map(text)


def test_an_existing_file_is_replaced_only_when_asked(surface: SurfaceMap, written: Path) -> None:
    before = written.read_bytes()
    with pytest.raises(OutputError, match="`overwrite`"):
        write_map(written, surface)
    assert written.read_bytes() == before
    write_map(written, surface.take(np.arange(1)), overwrite=True)
    assert read_map(written).size == 1


def test_a_failed_write_leaves_nothing(surface: SurfaceMap, tmp_path: Path) -> None:
    surface.meta["bad"] = float("nan")
    with pytest.raises(ValueError, match="JSON"):
        write_map(tmp_path / "map.npz", surface)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("version", [0, 4])
def test_another_version_is_refused(written: Path, version: int) -> None:
    rewrite(written, version=np.array(version))
    with pytest.raises(InputError, match=rf"version: is {version}; this program reads versions 1 "):
        read_map(written)


def test_a_map_of_version_1_is_read_and_what_was_moved_in_it_is_found(
    surface: SurfaceMap, written: Path
) -> None:
    walls = surface.take(surface.depth > 0).origin
    assert {0, 1} <= set(walls.tolist())
    drawn = surface.with_columns(depth=surface.depth + (surface.depth > 0) * 0.1)
    assert drawn.moved.sum() == (walls == 0).sum()
    write_map(written, drawn, overwrite=True)
    rewrite(written, version=np.array(1), moved=None, noise=None)
    unknown = np.full(drawn.size, np.nan, dtype=np.float32)
    assert read_map(written) == replace(drawn, noise=unknown)


def test_in_a_map_of_version_2_no_noise_is_known(surface: SurfaceMap, written: Path) -> None:
    rewrite(written, version=np.array(2), noise=None)
    back = read_map(written)
    assert np.isnan(back.height_variance).all()
    assert replace(back, noise=surface.noise) == surface


def test_a_map_out_of_order_or_with_odd_meta_is_refused(written: Path) -> None:
    with np.load(written) as arrays:
        ix = arrays["ix"]
    rewrite(written, ix=np.append(ix[1:], ix[:1] - 1))
    with pytest.raises(InputError, match="sorted"):
        read_map(written)
    rewrite(written, ix=ix, meta=np.array("[1, 2]"))
    with pytest.raises(InputError, match="meta: holds a JSON list"):
        read_map(written)


def test_free_space_is_kept_and_each_of_its_arrays_is_checked(
    surface: SurfaceMap, tmp_path: Path
) -> None:
    counts = {(0, 0, 1): 3, (0, 0, 2): 1, (0, 3, -5): 9, (1, -2, 7): 255}
    path = tmp_path / "flight.npz"
    for free in (free_space_of(counts), FreeSpace.of_none(), None):
        write_map(path, replace(surface, free=free), overwrite=True)
        back = read_map(path)
        assert back.free == free
        assert back == replace(surface, free=free)
    free = free_space_of(counts)
    write_map(path, replace(surface, free=free), overwrite=True)
    with np.load(path) as kept:
        good = dict(kept)
    assert int(good["version"]) == 3
    for name, dtype in FREE_COLUMNS.items():
        column = good[f"free_{name}"]
        assert column.dtype == dtype
        for changed in (None, np.array([b"x"]), column.reshape(1, -1), column[0], column[:-1]):
            np.savez(
                path,
                **{n: a for n, a in (good | {f"free_{name}": changed}).items() if a is not None},
            )
            with pytest.raises(InputError, match=r"flight\.npz: free_\w+: ") as caught:
                read_map(path)
            assert "\n" not in str(caught.value)
    np.savez(path, **good | {"free_start": good["free_start"][::-1]})
    with pytest.raises(InputError, match=r"flight\.npz: free_start: must ascend from 0 to 4"):
        read_map(path)


def test_free_space_of_a_size_that_is_only_claimed_is_refused(
    surface: SurfaceMap, written: Path
) -> None:
    write_map(written, replace(surface, free=FreeSpace.of_none()), overwrite=True)
    claim_size(written, "free_iz", "<i4")
    with pytest.raises(InputError, match="free_iz: declares"):
        read_map(written)
