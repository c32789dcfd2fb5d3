"""Temporary files and folders go with their program, also where it is killed.

Ways to pass without being right: everything that looks temporary is removed, also what another
program is writing at the moment, or what belongs to the user.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from mlscli.runtime.temporary import KEPT, remove_abandoned, temporary_file, temporary_folder

HOLDS = """
import pathlib, sys
from mlscli.runtime.temporary import temporary_file, temporary_folder
folder = pathlib.Path(sys.argv[1])
with temporary_file(folder, "map.npz") as (stream, _), temporary_folder(folder, "bag") as made:
    (made / "part").write_text("half")
    print("ready", flush=True)
    sys.stdin.read()
"""


def test_what_a_killed_program_left_goes_and_what_a_living_one_writes_stays(
    tmp_path: Path,
) -> None:
    for kept in (".map.npz.original", ".mls-notes", "map.npz"):
        (tmp_path / kept).write_text("of the user")
    own = set(tmp_path.iterdir())
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, tmp_path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        while_it_lives = set(tmp_path.iterdir())
        assert len(while_it_lives - own) == 2
        remove_abandoned(tmp_path)
        assert set(tmp_path.iterdir()) == while_it_lives
        os.kill(program.pid, signal.SIGKILL)
    assert set(tmp_path.iterdir()) == while_it_lives
    with temporary_file(tmp_path, "other") as (_, path):
        assert set(tmp_path.iterdir()) == {*own, path}
    assert set(tmp_path.iterdir()) == own


def test_a_folder_with_what_may_be_the_only_copy_stays(tmp_path: Path) -> None:
    left = tmp_path / ".bag.mls-12345678"
    (left / KEPT).mkdir(parents=True)
    with temporary_folder(tmp_path, "bag") as made:
        assert set(tmp_path.iterdir()) == {left, made}
    assert [left] == list(tmp_path.iterdir())


def test_long_names_leave_room_for_what_is_added(tmp_path: Path) -> None:
    with temporary_file(tmp_path, "ü" * 127) as (stream, path):
        stream.write(b"whole")
        path.rename(tmp_path / ("ü" * 127))
    assert (tmp_path / ("ü" * 127)).read_bytes() == b"whole"
