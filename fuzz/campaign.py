"""Inputs one after the other, and what is kept of them."""

from __future__ import annotations

import os
import pickle
import shlex
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from random import Random

from fuzz.child import Ended, Limits, new_folder, run
from fuzz.judging import Finding, judge, kind_of, listed, outcome
from fuzz.mutation import Material, mutate
from fuzz.packing import parts_of
from fuzz.targets import Seed, Target

_MOST_KEPT = 3
"""Of each fault so many inputs are kept."""

_CORPUS = 300
"""So many inputs with outcomes that were new are changed further."""


@dataclass
class Tally:
    """What came of the inputs of a target.

    Attributes
    ----------
    inputs : int
    kinds : Counter
        How many were refused, read with loss, and built.
    findings : Counter
        How many times each fault was found, by its mark.
    seconds : float
    memory : int
        The highest peak of bytes beyond those of the program itself.
    """

    inputs: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    findings: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    memory: int = 0


class Campaign:
    """The inputs of one target.

    Parameters
    ----------
    name : str
    target : Target
    seeds : list of Seed
    seed : int
        Of the dice. The same seed makes the same inputs, as long as the program does the same.
    limits : Limits
    keep : Path
        Where inputs with findings are kept.
    """

    def __init__(
        self, name: str, target: Target, seeds: list[Seed], seed: int, limits: Limits, keep: Path
    ) -> None:
        self.name, self.target, self.tally = name, target, Tally()
        self._limits, self._keep = limits, keep
        self._dice = Random(f"{seed} {name}")
        self._seeds, self._corpus = seeds, list[Seed]()
        self._seen: set[str] = set()
        files = [seed.files[file] for seed in seeds for file in seed.changed]
        parts = [part.content for file in files for part in parts_of(file)[:20]]
        self._material = Material.of([*files, *parts])
        self._turns: Iterator[int] = count()

    def step(self) -> list[Finding]:
        """Try one more input: a changed one, or a seed as it is, until all commands had each."""
        turn = next(self._turns)
        commands = self.target.commands
        seed, command = divmod(turn // 2, len(commands))
        if turn % 2 == 0 and seed < len(self._seeds):
            tried, words = self._seeds[seed], commands[command]
        else:
            tried, words = self._changed(), self._dice.choice(commands)
        with new_folder() as folder:
            ended, found = self._tried(tried, words, folder)
            for each in {each.mark: each for each in found}.values():
                self._found(each, words, folder, turn)
        if not found and (mark := outcome(ended)) not in self._seen:
            self._seen.add(mark)
            if len(self._corpus) < _CORPUS:
                self._corpus.append(tried)
        return found

    def _tried(self, tried: Seed, words: str, folder: Path) -> tuple[Ended, list[Finding]]:
        for each in ("in", "out", "tmp"):
            (folder / each).mkdir()
        tried.write(folder / "in")
        before = listed(folder)
        target, tally = self.target, self.tally
        ended = run(shlex.split(words), folder, self._limits, target.main)
        tally.inputs += 1
        tally.kinds[kind_of(ended, target.answers)] += 1
        tally.seconds += ended.seconds
        tally.memory = max(tally.memory, ended.memory)
        return ended, judge(ended, target.answers, self._limits, folder, before)

    def _changed(self) -> Seed:
        dice = self._dice
        from_corpus = self._corpus and dice.random() < 0.5
        seed = dice.choice(self._corpus if from_corpus else self._seeds)
        files = dict(seed.files)
        for _ in range(dice.choice((1, 1, 1, 2))):
            name = dice.choice(seed.changed)
            files[name] = self._mutated(files[name])
        return seed._replace(files=files)

    def _mutated(self, data: bytes) -> bytes:
        parts = parts_of(data) if self._dice.random() < 0.7 else []
        if not parts:
            return mutate(data, self._dice, self._material)
        part = self._dice.choice(parts)
        return part.packed(mutate(part.content, self._dice, self._material))

    def _found(self, finding: Finding, words: str, folder: Path, turn: int) -> None:
        """Count a finding, and keep its input, with how to try it again."""
        self.tally.findings[finding.mark] += 1
        if self.tally.findings[finding.mark] > _MOST_KEPT:
            return
        kept = self._keep / f"{self.name}-{turn}-{finding.kind.replace(' ', '-')}"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(folder / "in", kept / "in")
        shutil.copytree(folder / "said", kept / "said")
        (kept / "out").mkdir()
        lines = (finding.words, f"cd {shlex.quote(str(kept.resolve()))} && mls --debug {words}")
        (kept / "again.txt").write_text("\n".join([*lines, ""]), "utf-8", "backslashreplace")


def made(make: Callable[[Path], dict[str, list[Seed]]]) -> dict[str, list[Seed]]:
    """Return the seeds of targets, made in a process of their own.

    Libraries that write them start threads, which forks of this process would lack.
    """
    with new_folder() as whole:
        folder, result = whole / "seeds", whole / "result"
        folder.mkdir()
        child = os.fork()
        if not child:
            try:
                result.write_bytes(pickle.dumps(make(folder)))
                os._exit(0)
            except BaseException:
                import traceback

                traceback.print_exc()
            finally:
                os._exit(1)
        _, status = os.waitpid(child, 0)
        if status:
            raise RuntimeError("no seeds could be made; the reason stands above")
        seeds: dict[str, list[Seed]] = pickle.loads(result.read_bytes())
        return seeds


def take_turns(
    campaigns: Iterable[Campaign], seconds: float | None, inputs: int | None
) -> Iterator[tuple[Campaign, Finding]]:
    """Try inputs of one target after the other, and yield what is found.

    Parameters
    ----------
    campaigns : iterable of Campaign
    seconds : float or None
        How long.
    inputs : int or None
        How many of each; the unchanged seeds are counted.
    """
    waiting, begin = list(campaigns), time.perf_counter()
    while waiting and (seconds is None or time.perf_counter() - begin < seconds):
        for campaign in list(waiting):
            if inputs is not None and campaign.tally.inputs >= inputs:
                waiting.remove(campaign)
                continue
            for finding in campaign.step():
                yield campaign, finding


def table(tallies: Mapping[str, Tally]) -> str:
    """Return a row for each target, and their sum."""
    rows = ["| target | inputs | refused | with loss | built | findings | seconds | peak MiB |"]
    rows.append("|:--|--:|--:|--:|--:|--:|--:|--:|")
    total = Tally()
    for name, tally in tallies.items():
        total.inputs += tally.inputs
        total.kinds += tally.kinds
        total.findings += tally.findings
        total.seconds += tally.seconds
        total.memory = max(total.memory, tally.memory)
        rows.append(_row(name, tally))
    return "\n".join([*rows, _row("all", total), ""])


def _row(name: str, tally: Tally) -> str:
    kinds = " | ".join(f"{tally.kinds[kind]:,}" for kind in ("refused", "with loss", "built"))
    return (
        f"| {name} | {tally.inputs:,} | {kinds} | {sum(tally.findings.values()):,} "
        f"| {tally.seconds:.0f} | {tally.memory >> 20:,} |"
    )
