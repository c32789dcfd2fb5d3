"""What a run may not do, whatever it was given."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from fuzz.child import Ended, Limits

STATUSES = frozenset({0, 1, 2, 3, 4})
"""The documented ones of a run that nobody has interrupted."""

_WARNING = re.compile(r"^\S+:\d+: \w*Warning: ", re.MULTILINE)
_ERROR = re.compile(r"mls(?: [a-z]+)*: ")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
_LONGEST = 2100

# What differs between two runs with the same fault.
_VARIABLE = re.compile(r"'[^']*'|\"[^\"]*\"|0x[0-9a-f]+|[-+]?\d[\d,.e+-]*|\S*/\S*")


class Finding(NamedTuple):
    """Something that a run must not do.

    Attributes
    ----------
    kind : str
    words : str
        What it was, in a line.
    """

    kind: str
    words: str

    @property
    def mark(self) -> str:
        """What is the same in all findings of one fault."""
        return f"{self.kind}: {_VARIABLE.sub('#', self.words)[:200]}"


def is_answer(ended: Ended, answers: frozenset[int]) -> bool:
    """Return whether a run ended in an answer; where 1 may be one, something was printed."""
    return ended.status in answers and (ended.status != 1 or bool(ended.out.strip()))


def kind_of(ended: Ended, answers: frozenset[int]) -> str:
    """Return whether the input was ``refused``, or read, ``with loss`` or ``built``."""
    if not is_answer(ended, answers):
        return "refused"
    return "with loss" if ended.status == 3 else "built"


def outcome(ended: Ended) -> str:
    """Return what tells outcomes apart: status and last words, without what varies."""
    lines = [_VARIABLE.sub("#", line)[:160] for line in ended.err.splitlines()[-4:]]
    return f"{ended.status} {' / '.join(lines)} {_VARIABLE.sub('#', ended.out)[:160]}"


def judge(
    ended: Ended, answers: frozenset[int], limits: Limits, folder: Path, before: set[str]
) -> list[Finding]:
    """Return what was found in a run.

    Parameters
    ----------
    ended : Ended
    answers : frozenset of int
        Exit statuses that are no errors.
    limits : Limits
    folder : Path
        Where it ran.
    before : set of str
        What lay in the folder before, by `listed`.
    """
    found = [Finding("hang", _innermost(ended.err))] if ended.is_late else []
    if ended.status < 0 and not ended.is_late:
        found.append(Finding("signal", f"{-ended.status}: {_innermost(ended.err)}"))
    if "out of memory" in ended.err or "MemoryError" in ended.err or ended.memory > limits.memory:
        found.append(Finding("memory", f"{ended.memory >> 20} MiB: {_last(ended.err)}"))
    if not ended.is_late and ended.status >= 0:
        found += _said(ended, answers)
    found += [Finding("elsewhere", line) for line in ended.touched if not _is_unsound(line)]
    found += [Finding("unsound map", line) for line in ended.touched if _is_unsound(line)]
    found += [Finding("elsewhere", f"in place: {line}") for line in sorted(listed(folder) ^ before)]
    return found + _left(ended, answers, folder)


def _said(ended: Ended, answers: frozenset[int]) -> list[Finding]:
    """Return what is wrong with the words of a run that ended by itself."""
    found, lines = [], ended.err.splitlines()
    if "Traceback (most recent call last)" in ended.err:
        found.append(Finding("traceback", _last(ended.err)))
    if internal := [line for line in lines if ": internal error: " in line]:
        found.append(Finding("internal error", internal[0]))
    if warning := _WARNING.search(ended.err):
        found.append(Finding("warning", ended.err[warning.start() :].splitlines()[0]))
    if ended.status not in STATUSES:
        found.append(Finding("status", f"{ended.status}: {_last(ended.err)}"))
    if control := _CONTROL.search(ended.out + ended.err):
        found.append(Finding("control character", repr(control[0])))
    if found or is_answer(ended, answers):
        return found
    if not lines:
        found.append(Finding("no word", f"status {ended.status}"))
    elif not all(_ERROR.match(line) for line in lines):
        found.append(Finding("lines", next(x for x in lines if not _ERROR.match(x))[:200]))
    elif longest := max(lines, key=len)[_LONGEST:]:
        found.append(Finding("lines", f"{_LONGEST + len(longest)} characters"))
    return found


def _left(ended: Ended, answers: frozenset[int], folder: Path) -> list[Finding]:
    """Return what is wrong with what a run has left in the output's folder and that of scratch."""
    out = sorted(path.name for path in (folder / "out").iterdir())
    found = []
    if not is_answer(ended, answers) and ended.status >= 0 and out:
        found.append(Finding("output of an error", f"status {ended.status}: {', '.join(out)}"))
    parts = [name for name in out if ".mls-" in name]
    parts += sorted(path.name for path in (folder / "tmp").iterdir())
    if parts and ended.status >= 0:
        found.append(Finding("left behind", ", ".join(parts)))
    return found


def listed(folder: Path) -> set[str]:
    """Return what lies in a folder, but for what a run may write, with sizes and times."""
    found = {
        f"{path.relative_to(folder)} {path.lstat().st_size} {path.lstat().st_mtime_ns}"
        for path in (folder / "in").rglob("*")
        if not path.is_dir()
    }
    return found | {path.name for path in folder.iterdir() if path.name != "said"}


def _is_unsound(line: str) -> bool:
    return line.startswith("unsound: ")


def _last(text: str) -> str:
    return (text.splitlines() or [""])[-1][:300]


def _innermost(text: str) -> str:
    """Return the innermost places in the program of a stack that faulthandler wrote."""
    places = [line.strip() for line in text.splitlines() if line.strip().startswith("File ")]
    own = [line for line in places if "mlscli" in line] or places
    return " < ".join(
        re.sub(r'File ".*/(\S+)", line (\d+) in (\S+)', r"\1:\2 \3", x) for x in own[:3]
    )
