"""What is no regular file is refused as an input, by whatever reads it, and nothing waits for it.

Ways to pass without being right: to try the readers of sources alone; to look for FIFOs, and open
what has become one since.
"""

from __future__ import annotations

import os
import re
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mlscli.config import load
from mlscli.errors import ConfigError, InputError
from mlscli.io.clouds.structures import bytes_of
from mlscli.io.clouds.trajectory import read_trajectory
from mlscli.io.files import open_input
from mlscli.io.reading.formats import open_source
from mlscli.io.writing.npz import is_map, read_map
from mlscli.scenes.sceneio import load_scene


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


READERS: dict[str, Callable[[Path], Any]] = {
    "a source": open_source,
    "a map": read_map,
    "a route": read_trajectory,
    "a configuration": load,
    "a scene": load_scene,
    "any other": open_input,
}


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused_in_one_line(tmp_path: Path, reader: str) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("fifo", "zero"):
        with pytest.raises((InputError, ConfigError)) as caught:
            READERS[reader](tmp_path / name)
        assert re.fullmatch(rf"{tmp_path / name}: is (a|neither) .*", str(caught.value))
        assert not is_map(tmp_path / name)


def test_sockets_are_told_and_files_and_folders_read_as_ever(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(tmp_path / "socket"))
        with pytest.raises(InputError, match="socket: is a socket, expected a file"):
            open_input(tmp_path / "socket")
    with pytest.raises(IsADirectoryError):
        open_input(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_input(tmp_path / "missing")
    (tmp_path / "file").write_text("held")
    with open_input(tmp_path / "file") as file:
        assert file.read() == b"held"


@pytest.mark.parametrize(
    ("parts", "fifo"),
    [
        (["x.mcap"], "metadata.yaml"),
        ([], "x.db3"),
        (["points3D.txt"], "images.txt"),
        (["reconstruction.json"], "tracks.csv"),
    ],
)
def test_a_part_of_a_folder_that_is_no_file_is_refused(
    tmp_path: Path, parts: list[str], fifo: str
) -> None:
    for part in parts:
        (tmp_path / part).write_text('{"cameras": {}, "shots": {}, "points": {}}')
    os.mkfifo(tmp_path / fifo)
    with pytest.raises(InputError, match=f"{fifo}: is a FIFO") as caught:
        list(open_source(tmp_path).clouds())
    assert "\n" not in str(caught.value)


def test_a_file_that_is_cut_while_it_is_read_ends_nothing(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    path.write_bytes(b"\1" * 100_000)
    data = bytes_of(path)
    os.truncate(path, 0)
    assert int(data.sum()) == 100_000
