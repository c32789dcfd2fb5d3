"""Programs that are killed: ``python -m benchmarks.kills`` (minutes).

Each command writes over what it wrote before and is killed (SIGKILL) at a random moment, every
other time soon after a file of its own has appeared beside the output. Each output must then be
the old one or the new one, to the byte, and what else was left must be gone after the next run.

Then builds that keep what they have evaluated are killed and resumed.
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import click

from benchmarks.installed import SAMPLE
from benchmarks.large import CELL, write_survey
from benchmarks.table import lines

HEAD = ("command", "killed", "old outputs", "new outputs", "torn", "files left", "left at last")
# How long a write of these outputs takes at most, in seconds.
_WRITING = 0.02

Words = list[str]


def commands(inputs: Path, outputs: Path) -> dict[str, tuple[Words, Words]]:
    """Return commands, each in two forms that differ in what they write; the inputs are made."""
    usual = ["--overwrite", "-o"]
    build = ["build", str(SAMPLE), *usual, str(outputs / "map.npz"), "--set"]
    mapped = str(inputs / "map.npz")
    _done(["build", str(SAMPLE), "-o", mapped])
    mesh = ["export", mapped, *usual, str(outputs / "mesh.ply"), "--max-slope"]
    flight = ["synth", "--type", "bridge", *usual, str(outputs / "flight.bag"), "--seed"]
    return {
        "build": ([*build, "map.cell_size=0.5"], [*build, "map.cell_size=0.7"]),
        "export, PLY": ([*mesh, "1"], [*mesh, "2"]),
        "synth, a bag and its truth": ([*flight, "1"], [*flight, "2"]),
    }


def kill(words: tuple[Words, Words], outputs: Path, kills: int, chance: random.Random) -> list[int]:
    """Kill a command again and again; return what became of its outputs, as in `HEAD`."""
    killed, replaced = words
    begin = time.monotonic()
    _done(killed)
    seconds = time.monotonic() - begin
    new = _contents(outputs)
    _done(replaced)
    old = _contents(outputs)
    found: Counter[str] = Counter()
    for number in range(kills):
        process = _run(killed)
        if number % 2:
            time.sleep(chance.uniform(0, seconds))
        else:
            while process.poll() is None and set(_contents(outputs)) == set(old):
                time.sleep(1e-3)
            time.sleep(chance.uniform(0, _WRITING))
        process.kill()
        found["killed"] += process.wait() != 0
        after = _contents(outputs)
        for name in old:
            there = after.pop(name, b"")
            which = "old" if there == old[name] else "new" if there == new[name] else "torn"
            found[which] += 1
        found["left"] += len(after)
        _done(replaced)
        found["left at last"] += len(set(_contents(outputs)) - set(old))
    return [found[what] for what in ("killed", "old", "new", "torn", "left", "left at last")]


def resume(folder: Path, kills: int, chance: random.Random) -> str:
    """Kill and resume builds of a flight; say how many went on, and how many maps were the same."""
    write_survey(folder / "survey.bag", 400_000)
    build = ["build", str(folder / "survey.bag"), "--set", f"map.cell_size={CELL}", "--jobs", "2"]
    whole, target = folder / "whole.npz", folder / "map.npz"
    begin = time.monotonic()
    _done([*build, "-o", str(whole)])
    seconds = time.monotonic() - begin
    found: Counter[str] = Counter()
    for _ in range(kills):
        process = _run([*build, "-o", str(target), "--checkpoint-every", "0s"])
        time.sleep(chance.uniform(0.3 * seconds, seconds))
        process.kill()
        found["killed"] += process.wait() != 0
        found["kept"] += any(folder.glob("map.npz.checkpoint/tiles-*"))
        _done([*build, "-o", str(target), "--resume", "--overwrite"])
        found["same"] += target.read_bytes() == whole.read_bytes()
        found["left"] += len(list(folder.iterdir())) - 3
        target.unlink()
    return (
        f"{found['killed']} of {kills} builds killed, {found['kept']} after tiles were kept; "
        f"resumed, {found['same']} made the same map, and left {found['left']} files"
    )


def _done(words: Words) -> None:
    if _run(words).wait():
        raise RuntimeError(f"mls {' '.join(words)}: failed")


def _run(words: Words) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "mlscli", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _contents(folder: Path) -> dict[str, bytes]:
    """Return what lies in a folder, by name."""
    found = {}
    for path in folder.iterdir():
        # What is renamed just now is not there.
        with suppress(FileNotFoundError):
            found[path.name] = b"" if path.is_dir() else path.read_bytes()
    return found


@click.command()
@click.option("--kills", default=50, help="Of each command.")
@click.option("--seed", default=1, help="Of the moments.")
def main(kills: int, seed: int) -> None:
    """Print the table; outputs and what was left are counted over all kills."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory() as made:
        inputs, outputs = Path(made, "inputs"), Path(made, "outputs")
        inputs.mkdir()
        outputs.mkdir()
        rows = []
        told = resume(inputs, kills, chance)
        for name, words in commands(inputs, outputs).items():
            rows.append((name, *map(str, kill(words, outputs, kills, chance))))
            for path in outputs.iterdir():
                path.unlink()
    for line in lines(HEAD, rows):
        click.echo(line)
    click.echo(told)


if __name__ == "__main__":
    main()
