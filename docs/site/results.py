"""The JSON that commands print: JSON Schema and a page, made of docs/results.yaml."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "docs/results.yaml"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def _told() -> dict[str, Any]:
    told: dict[str, Any] = yaml.safe_load(SOURCE.read_text(encoding="utf-8"))
    return told


def names() -> list[str]:
    """Return the names of the results."""
    return list(_told()["results"])


def schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of a result."""
    parts = {**_told()["shared"], **_told()["parts"]}
    made = _schema(_told()["results"][name])
    used = {part: _schema(what) for part, what in parts.items()}
    return {"$schema": DIALECT, "$defs": used, **made}


def _schema(told: Any) -> dict[str, Any]:
    if isinstance(told, list):
        return {"type": "array", "items": _schema(told[0])}
    if isinstance(told, dict):
        return _object(told)
    kind, _, what = told.partition(" ")
    kind, can_be_null = kind.removesuffix("~"), kind.endswith("~")
    made: dict[str, Any] = {}
    if kind.startswith("="):
        made = {"$ref": f"#/$defs/{kind[1:]}"}
        if can_be_null:
            made = {"anyOf": [made, {"type": "null"}]}
    elif kind != "any":
        made = {"type": [kind, "null"] if can_be_null else kind}
    return made | ({"description": what} if what else {})


def _object(told: dict[str, Any]) -> dict[str, Any]:
    keys = _keys(told)
    others = keys.pop("*", None)
    return {
        "type": "object",
        "properties": {key.removesuffix("?"): _schema(value) for key, value in keys.items()},
        "required": [key for key in keys if not key.endswith("?")],
        "additionalProperties": False if others is None else _schema(others),
    }


def _keys(told: dict[str, Any]) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    for key, value in told.items():
        if key == "+":
            keys |= _told()["shared"][value]
        elif key != "command":
            keys[key] = value
    return keys


def page() -> str:
    """Return the page of all results, in Markdown."""
    lines = [
        "# JSON results",
        "",
        "What `--json` prints. Lengths are in the unit of the map, times in seconds. All keys are "
        "there unless *optional*; *or null* says where a value can be missing. The same as JSON "
        "Schema lies beside this page: `results/NAME.schema.json`.",
    ]
    for name, told in _told()["results"].items():
        lines += ["", f"## {name}", "", f"{told['command']}.", "", *_table(told)]
    for name, told in {**_told()["shared"], **_told()["parts"]}.items():
        lines += ["", f"### {name}", "", *_table(told if isinstance(told, dict) else {"": told})]
    return "\n".join((*lines, ""))


def _table(told: dict[str, Any]) -> Iterator[str]:
    yield from ("| key | type | |", "|:--|:--|:--|")
    for key, value in _rows(_keys(told), ""):
        kind, what = _words(value)
        optional = "optional; " if key.endswith("?") else ""
        shown = f"`{key.removesuffix('?')}`".replace("*", "NAME") if key else ""
        yield f"| {shown} | {kind} | {optional}{what} |"


def _rows(keys: dict[str, Any], before: str) -> Iterator[tuple[str, Any]]:
    for key, value in keys.items():
        if isinstance(value, dict):
            yield from _rows(value, f"{before}{key.removesuffix('?')}.")
        else:
            yield f"{before}{key}", value


def _words(value: Any) -> tuple[str, str]:
    if isinstance(value, list):
        kind, what = _words(value[0])
        return f"list of {kind}", what
    kind, _, what = value.partition(" ")
    null = " or null" if kind.endswith("~") else ""
    kind = kind.removesuffix("~")
    if kind.startswith("="):
        kind = f"[{kind[1:]}](#{kind[1:]})"
    return f"{kind}{null}", what.replace("|", "\\|")
