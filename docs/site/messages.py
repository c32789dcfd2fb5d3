"""The messages of the program, taken out of its code, as a page to search in.

A text that is put together from parts is told with … for each part that a run fills in. Which
texts are messages is told by where they stand: those of errors, whatever they say, and all others
of a few words that are no docstrings, no help and no keys.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import mlscli
from mlscli.errors import MlsError, with_options

PACKAGE = Path(mlscli.__file__).parent

FILLED = "…"
"""What stands for a part that a run fills in."""

_FEWEST_WORDS = 4
_WORD = re.compile(r"\b[a-z]{2,}\b")
# Code, several lines, and sentences of a help.
_NONE = re.compile(r"<|from \w+\.|.*\n|.*[^.]\.$")

# What is said where nothing went wrong, or to programmers.
_NO_MESSAGES = {"parameter", "option", "argument", "expect", "expect_path", "expect_items"}
_NO_KEYWORDS = {"help", "epilog", "summary", "unit"}

# Of the rooms of the program, what their messages are about.
_ROOMS = {
    "io/reading": "Recordings: which files, topics and frames",
    "io/containers": "Bags and MCAP files",
    "io/messages": "Messages in them",
    "io/clouds": "Clouds, trajectories and reconstructions in files",
    "io/plausibility": "Data that is not what its header claims",
    "io/writing": "Files to write",
    "io": "Other files",
    "geometry": "The vertical, and where things lie",
    "config": "Configurations",
    "parameters": "Values of parameters",
    "pipeline": "Stages, tiles and clusters",
    "building": "Building maps",
    "keyframes": "Keyframes and batches",
    "maps": "Maps and their files",
    "mesh": "Meshes",
    "queries": "Places, clearances and views",
    "rasters": "Layers and storeys",
    "aligning": "Maps brought into one frame",
    "scoring": "Maps compared",
    "scenes": "Synthetic flights",
    "plot": "Pictures",
    "view": "The page and the replay",
    "runtime": "The machine: room on disk, kernels",
    "trials": "Trials",
    "commands": "Commands and options",
    "": "Anything",
}


class Message(NamedTuple):
    """A message, or a part of one.

    Attributes
    ----------
    room : str
        The folder of the code that says it, one of `_ROOMS`.
    words : str
        With `FILLED` for what a run fills in, and options as they are typed.
    status : int or None
        The exit status that it ends with, where that is known.
    """

    room: str
    words: str
    status: int | None


def messages() -> list[Message]:
    """Return every message once, by room and words."""
    found: dict[tuple[str, str], int | None] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.name == "__init__.py" and path.parent == PACKAGE:
            continue
        room = _room(path.relative_to(PACKAGE).parent.as_posix())
        for words, status in _of(ast.parse(path.read_text(encoding="utf-8"))):
            found[room, words] = found.get((room, words)) or status
    return sorted(Message(*key, status) for key, status in found.items())


def _room(folder: str) -> str:
    while folder not in _ROOMS:
        folder = folder.rpartition("/")[0]
    return "" if folder == "." else folder


def _of(module: ast.Module) -> Iterator[tuple[str, int | None]]:
    """Yield the messages of a module, and the exit status of those of errors."""
    statuses = _statuses()
    in_errors: dict[ast.AST, int | None] = {}
    left_out: set[ast.AST] = set()
    for node in ast.walk(module):
        if isinstance(node, ast.Call) and _name(node.func) in statuses:
            in_errors |= {part: statuses[_name(node.func)] for part in ast.walk(node)}
        elif isinstance(node, ast.Call) and _name(node.func) in _NO_MESSAGES:
            left_out |= {*ast.walk(node)}
        elif isinstance(node, ast.keyword) and node.arg in _NO_KEYWORDS:
            left_out |= {*ast.walk(node.value)}
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            left_out.add(node.value)
        elif isinstance(node, ast.JoinedStr):
            left_out |= {part for part in node.values if isinstance(part, ast.Constant)}
    for node in ast.walk(module):
        words = "" if node in left_out else _words(node)
        least = 2 if node in in_errors else _FEWEST_WORDS
        if not _NONE.match(words) and len(_WORD.findall(words)) >= least:
            # What is filled in ends a word.
            spoken = with_options(words.replace(FILLED, f" {FILLED} "))
            yield spoken.replace(f" {FILLED} ", FILLED), in_errors.get(node)


def _statuses() -> dict[str, int | None]:
    """Return the exit status of each error by name; None: it depends on what reads the file."""
    found: dict[str, int | None] = dict.fromkeys(
        ("DamagedError", "MalformedCloudError", "MalformedMessageError", "ValueError")
    )
    kinds = [MlsError]
    while kinds:
        kind = kinds.pop()
        kinds += kind.__subclasses__()
        found[kind.__name__] = kind.exit_status
    return found


def _name(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


def _words(node: ast.AST) -> str:
    """Return the text of a literal; "" where it is none."""
    if isinstance(node, ast.Constant):
        return node.value.strip(" ;,") if isinstance(node.value, str) else ""
    if not isinstance(node, ast.JoinedStr):
        return ""
    parts = (part.value if isinstance(part, ast.Constant) else FILLED for part in node.values)
    return "".join(map(str, parts)).strip(" ;,")


def page() -> str:
    """Return the page of all messages, in Markdown."""
    lines = [
        "# Messages",
        "",
        "All that the program says where something is wrong or doubtful, as its code has it: "
        f"search this page for the words that a run printed. {FILLED} stands for names, numbers "
        "and reasons. Errors end with the [status](../docs/commands.md#exit-status) before them; "
        "lines without are notes, losses, refusals of a part, and parts of other messages. "
        "What most people meet is told, with what to do, in "
        "[What went wrong](../docs/messages.md).",
    ]
    by_room: dict[str, list[Message]] = {}
    for message in messages():
        by_room.setdefault(message.room, []).append(message)
    for room, title in _ROOMS.items():
        if room in by_room:
            lines += ["", f"## {title}", "", "| status | message |", "|--:|:--|"]
            lines += [f"| {m.status or ''} | {_cell(m.words)} |" for m in by_room[room]]
    return "\n".join((*lines, ""))


def _cell(words: str) -> str:
    """Return words as code in a cell of a table, backquotes and bars as they are."""
    fence = "``" if "`" in words else "`"
    inner = f" {words} " if "`" in words else words
    return f"{fence}{inner}{fence}".replace("|", "\\|")
