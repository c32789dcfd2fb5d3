"""What must not be replaced, and what is written where a link or a device stands.

Ways to pass without being right: a source is known by its name alone, not where it lies; a folder
that holds it is replaced, or is said to be what it is not; a link is replaced by a file, which
nobody sees who looks at its name alone.
"""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from mlscli.errors import OutputError
from mlscli.io.writing.atomic import atomic_write, is_same, refuse_existing, refuse_sources


def test_neither_a_source_nor_a_folder_with_one_is_replaced(tmp_path: Path) -> None:
    source = tmp_path / "flight" / "deep" / "a.txt"
    source.parent.mkdir(parents=True)
    source.write_text("1 2 3")
    link = tmp_path / "link"
    link.symlink_to(source)
    hard = tmp_path / "hard"
    hard.hardlink_to(source)
    for target in (source, source.parent / ".." / "deep" / "a.txt", link, hard):
        with pytest.raises(OutputError, match=r": is the source itself; choose another name"):
            refuse_existing(target, overwrite=True, sources=[source])
    for target in (tmp_path / "flight", source.parent):
        with pytest.raises(OutputError) as caught:
            refuse_sources(target, [link])
        assert str(caught.value) == f"{target}: holds the source {link}; choose another name"
    beside = source.with_name("b.txt")
    refuse_existing(beside, overwrite=False, sources=[source, tmp_path / "missing"])
    refuse_sources(tmp_path / "new", [source])


@pytest.mark.parametrize(
    ("source", "part"),
    [
        ("flight", "flight/part_0.mcap"),
        ("flight/metadata.yaml", "flight/part_0.db3"),
        ("model/points3D.bin", "model/images.bin"),
        ("model", "model/points3D.bin"),
        ("odm/reconstruction.json", "odm/tracks.csv"),
    ],
)
def test_parts_of_a_source_are_not_replaced_either(tmp_path: Path, source: str, part: str) -> None:
    for file in (tmp_path / source, tmp_path / part):
        file.parent.mkdir(parents=True, exist_ok=True)
        if file.suffix:
            file.write_text("held")
    (tmp_path / source).parent.joinpath("link").symlink_to(tmp_path / part)
    for target in (tmp_path / part, (tmp_path / source).parent / "link"):
        with pytest.raises(OutputError) as caught:
            refuse_existing(target, overwrite=True, sources=[tmp_path / source])
        assert str(caught.value) == (
            f"{target}: is a part of the source {tmp_path / source}; choose another name"
        )


def test_maps_that_lie_in_a_source_s_folder_are_replaced(tmp_path: Path) -> None:
    for name in ("map.npz", "page.html", "map.png"):
        (tmp_path / name).write_text("old")
        refuse_existing(tmp_path / name, overwrite=True, sources=[tmp_path])
    refuse_existing(tmp_path / "new.mcap", overwrite=True, sources=[tmp_path])


def test_the_file_behind_a_link_is_written_and_the_link_stays(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link = tmp_path / "link.npz"
    link.symlink_to("there/map.npz")
    for content in (b"first", b"second"):
        with atomic_write(link, overwrite=content == b"second") as stream:
            stream.write(content)
        assert link.is_symlink()
        assert (tmp_path / "there" / "map.npz").read_bytes() == content
    with pytest.raises(OutputError, match="exists already"):
        refuse_existing(link, overwrite=False)
    assert [file.name for file in (tmp_path / "there").iterdir()] == ["map.npz"]


@pytest.mark.parametrize(
    ("leads_to", "why"),
    [("nowhere/map.npz", "the folder .*nowhere does not exist"), ("link", "leads to itself")],
)
def test_a_link_behind_which_nothing_can_be_written_is_refused(
    tmp_path: Path, leads_to: str, why: str
) -> None:
    link = tmp_path / "link"
    link.symlink_to(leads_to)
    with pytest.raises(OutputError, match=f"^{link}: .*{why}"):
        refuse_existing(link, overwrite=True)


def test_what_is_no_file_is_never_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(tmp_path / "socket"))
        (tmp_path / "null").symlink_to("/dev/null")
        for name, what in (("fifo", "a FIFO"), ("socket", "a socket"), ("null", "a device")):
            for overwrite in (False, True):
                with pytest.raises(OutputError, match=f"{name}: is {what}, which is never"):
                    refuse_existing(tmp_path / name, overwrite=overwrite)


def test_names_of_one_file_are_told_also_where_it_is_not_there_yet(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    assert is_same(tmp_path / "link" / "q.npz", tmp_path / "there" / ".." / "there" / "q.npz")
    assert not is_same(tmp_path / "link" / "q.npz", tmp_path / "q.npz")


def test_who_could_not_read_a_file_cannot_read_what_replaces_it(tmp_path: Path) -> None:
    secret = tmp_path / "map.npz"
    secret.write_text("old")
    secret.chmod(0o600)
    with atomic_write(secret, overwrite=True) as stream:
        stream.write(b"new")
    assert (secret.read_bytes(), secret.stat().st_mode & 0o777) == (b"new", 0o600)
