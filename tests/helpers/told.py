"""Pages that show commands, each behind ``$``, and what they print."""

from __future__ import annotations

import re
import shlex

LEFT_OUT = "..."
"""What stands for any number of lines, and at the end of a line for the rest of it."""


def steps(page: str) -> list[tuple[list[str], list[str]]]:
    """Return the words of each command of the page, and the lines that it is shown to print."""
    blocks = re.findall(r"^    \$ .*\n(?:^    .*\n)*", page, flags=re.MULTILINE)
    told = "".join(re.sub("^    ", "", block, flags=re.MULTILINE) for block in blocks)
    _, *parts = re.split(r"^\$ ", told, flags=re.MULTILINE)
    lines = [part.splitlines() for part in parts]
    return [(shlex.split(command), shown) for command, *shown in lines]


def agrees(shown: list[str], printed: list[str]) -> bool:
    """Return whether lines are those printed, in order; ``...`` stands for any number of them.

    At the end of a line it stands for the rest of it.
    """
    if not shown:
        return not printed
    if shown[0].strip() == LEFT_OUT:
        return any(agrees(shown[1:], printed[row:]) for row in range(len(printed) + 1))
    begin, is_cut, _ = shown[0].partition(LEFT_OUT)
    same = printed[:1] == [begin] or (is_cut and printed and printed[0].startswith(begin))
    return bool(same) and agrees(shown[1:], printed[1:])
