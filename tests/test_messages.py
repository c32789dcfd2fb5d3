"""What the program says has its place in the reference, and so have its variables.

How one could cheat: a reference that names what its own rule finds, so errors are looked for here
by another rule, and what runs print is looked up; a page on messages that are no longer said.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import mlscli
from docs.site import messages
from mlscli.errors import with_options
from tests.helpers.program import mls

ROOT = Path(__file__).resolve().parent.parent
MODULES = sorted(Path(mlscli.__file__).parent.rglob("*.py"))
PAGE = messages.page()


def raised() -> Iterator[str]:
    """Yield the longest part of the words of each error that is raised with a text."""
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            call = node.exc if isinstance(node, ast.Raise) else None
            if not isinstance(call, ast.Call) or not call.args:
                continue
            parts = getattr(call.args[0], "values", [call.args[0]])
            texts = [str(part.value) for part in parts if isinstance(part, ast.Constant)]
            longest = max(texts, key=len, default="").strip(" ;,")
            if len(longest) > 20:
                yield with_options(longest)


def missing(page: str) -> list[str]:
    there = page.replace("\\|", "|")
    return [words for words in raised() if words not in there and "`" not in words]


def test_every_error_has_its_place() -> None:
    assert len([*raised()]) > 300
    assert missing(PAGE) == []
    assert missing(PAGE.replace("standard input is ", "")) != []


def test_what_runs_say_is_found_with_its_status(tmp_path: Path) -> None:
    (tmp_path / "some.bin").write_bytes(bytes(range(256)))
    np.savetxt(tmp_path / "a.txt", np.random.default_rng(1).uniform(0, 1, (60, 3)))
    rows = [
        (re.compile(".*".join(map(re.escape, words.split(messages.FILLED)))), status)
        for _, words, status in messages.messages()
        if len(words) > 12
    ]
    for words in (
        ("build", "some.bin"),
        ("build", "a.txt", "--latest", "--cumulative"),
        ("build", "a.txt", "--set", "map.cell_size=0.2", "-o", "a.txt"),
        ("plot", "absent.npz"),
    ):
        done = mls(*words, cwd=tmp_path)
        line = done.stderr.splitlines()[-1].removeprefix("mls: ")
        told = {status for pattern, status in rows if pattern.search(line)}
        assert told & {done.returncode, None}, line


def test_the_messages_that_are_explained_are_said() -> None:
    explained = re.findall(
        r"^\| `([^`]+)` \|", (ROOT / "docs/messages.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(explained) > 10
    said = " ".join(words for _, words, _ in messages.messages())
    assert [words for words in explained if words not in said] == []


@pytest.mark.parametrize("name", ["NUMBA_CACHE_DIR", "TMPDIR", "BROWSER"])
def test_the_table_of_variables_has_those_that_others_read(name: str) -> None:
    assert f"`{name}`" in variables()


def variables() -> str:
    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    return page.partition("## Variables of the environment")[2]


def test_every_variable_that_is_read_is_in_the_table() -> None:
    texts = [path.read_text(encoding="utf-8") for path in MODULES]
    names = {
        name
        for text in texts
        if "os.environ" in text
        for name in re.findall(r'"(_?[A-Z]{3,}(?:_[A-Z]+)*)"', text)
    }
    # Handed on to processes of its own; what numba is told there; a word of Linux's.
    own = {"PYTHONPATH", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "SWITCH"}
    assert {"TERM", "DISPLAY", "XDG_CACHE_HOME"} <= names
    assert sorted(name for name in names - own if f"`{name}`" not in variables()) == []
