"""PCD files, the Point Cloud Library's, as clouds.

A header of a word and its values a line, from ``VERSION`` to ``DATA``: ``FIELDS``, of each its
``SIZE`` in bytes, ``TYPE`` (F, I, U) and ``COUNT``; ``WIDTH``, ``HEIGHT``, ``POINTS`` and
``VIEWPOINT``. The points follow as rows (``ascii``), as records (``binary``), or field by field
and compressed (``binary_compressed``). Numbers in a text are read as they are written.

``VIEWPOINT`` says from where the points were measured: a position and an orientation, the latter
of which nothing is known here. It is where the craft was, in the frame of the points, which are
taken as they stand, as the Point Cloud Library takes them; its usual value, all zero, says
nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError
from mlscli.io.clouds.lzf import decompress
from mlscli.io.clouds.number_lines import Item, open_lines
from mlscli.io.clouds.pointfile import Content, PointFile, by_keyframe, shortfall, wanted_fields
from mlscli.io.clouds.structures import Member, mapped, read_structures
from mlscli.io.source import side_by_side
from mlscli.keyframes.keyframe import UNKNOWN_POSITION
from mlscli.runtime.arrays import Array

_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_DATA = ("ascii", "binary", "binary_compressed")
_LONGEST_HEADER = 1 << 20
_LARGEST_FIELD = 1 << 30


class PcdCloud(PointFile):
    """A PCD file: one keyframe, unless a field tells keyframes apart."""

    kind = "PCD cloud"

    def _read(self) -> Content:
        header = self._header()
        wanted = self._wanted(header)
        read = {"ascii": self._rows, "binary": self._records}.get(header.data, self._compressed)
        columns, fault = read(header, wanted)
        points = side_by_side(columns[:3])
        clouds = by_keyframe(points, columns[3] if len(columns) > 3 else None, header.position)
        lost = len(points) < header.points
        losses = [shortfall(self.path, len(points), header.points, fault)] if lost else []
        return Content(clouds, header.notes, losses)

    def _header(self) -> _Header:
        """Read the header.

        Raises
        ------
        InputError
            A line that is needed is missing or wrong.
        """
        with self.path.open("rb") as file:
            head = file.read(_LONGEST_HEADER)
        entries: dict[str, list[str]] = {}
        at = 0
        while "DATA" not in entries:
            line, newline, _ = head[at:].partition(b"\n")
            at += len(line) + len(newline)
            words = line.decode("utf-8", "replace").split()
            if words and not words[0].startswith("#"):
                entries[words[0].upper()] = words[1:]
            if not newline:
                break
        data = " ".join(entries.get("DATA", [])).lower()
        if data not in _DATA:
            raise InputError(
                f"{self.path}: found {f'DATA {data[:40]}' if data else 'no DATA'} in the header of "
                f"a PCD, expected DATA {', '.join(_DATA[:-1])} or {_DATA[-1]}"
            )
        names = entries.get("FIELDS") or entries.get("COLUMNS") or []
        if not names:
            raise InputError(f"{self.path}: found no FIELDS in the header of a PCD")
        sizes = self._numbers(entries, "SIZE", len(names), "4")
        counts = self._numbers(entries, "COUNT", len(names), "1")
        types = entries.get("TYPE", ["F"] * len(names))
        if len(types) != len(names):
            raise InputError(f"{self.path}: TYPE has {len(types)} values for {len(names)} FIELDS")
        fields = [_PcdField(*entry) for entry in zip(names, sizes, types, counts, strict=True)]
        width, height = self._numbers(entries, "WIDTH", 1, "0") + self._numbers(
            entries, "HEIGHT", 1, "1"
        )
        (points,) = self._numbers(entries, "POINTS", 1, str(width * height))
        notes = []
        if "WIDTH" in entries and width * height != points:
            notes.append(
                f"{self.path}: WIDTH x HEIGHT is {width * height:,} and POINTS {points:,}; POINTS "
                "is taken"
            )
        position = _position(entries.get("VIEWPOINT", []))
        if not math.isnan(position[0]):
            place = ", ".join(f"{value:g}" for value in position)
            notes.append(
                f"{self.path}: VIEWPOINT is taken as where the craft was, ({place}); the points "
                "are taken as they stand"
            )
        return _Header(fields, points, position, data, at, notes)

    def _numbers(
        self, entries: dict[str, list[str]], key: str, count: int, default: str
    ) -> list[int]:
        """Return the whole numbers of an entry."""
        words = entries.get(key, [default] * count)
        if len(words) != count or not all(
            w.isascii() and w.isdigit() and len(w) < 19 for w in words
        ):
            found = f"{key} {' '.join(words)}"
            raise InputError(
                f"{self.path}: found {found[:60]!r}, expected {count} whole number"
                f"{'' if count == 1 else 's'}"
            )
        return [int(word) for word in words]

    def _wanted(self, header: _Header) -> list[int]:
        """Return which fields are the coordinates, and the keyframe where there is one."""
        fields = header.fields
        for field in fields:
            if field.size * field.count > _LARGEST_FIELD:
                raise InputError(
                    f"{self.path}: the field {field.name} has SIZE {field.size} and COUNT "
                    f"{field.count}, more than a point can hold"
                )
        wanted = wanted_fields(
            field.name if field.count == 1 and field.size in _SIZES.get(field.type, ()) else ""
            for field in fields
        )
        if wanted is None:
            names = ", ".join(f"{f.name} ({f.type}{f.size} x {f.count})" for f in fields)
            raise InputError(
                f"{self.path}: has the FIELDS {names or 'none'}, expected one number x, y and z"
            )
        return wanted

    def _rows(self, header: _Header, wanted: Sequence[int]) -> tuple[list[Array], str]:
        """Return the wanted columns of a text, and what is wrong with its first broken row."""
        starts = list(accumulate((field.count for field in header.fields), initial=0))

        def pick(row: Sequence[Item], /) -> list[Item]:
            return [row[starts[place]] for place in wanted]

        with open_lines(self.path, header.size) as rows:
            values, fault = rows.read(header.points, pick, starts[-1])
        return list(values.reshape(-1, len(wanted)).T), fault

    def _records(self, header: _Header, wanted: Sequence[int]) -> tuple[list[Array], str]:
        """Return the wanted columns of points one after the other."""
        fields = [
            Member(field.name, field.dtype if place in wanted else f"V{field.size * field.count}")
            for place, field in enumerate(header.fields)
        ]
        data = mapped(self.path)[header.size :]
        return read_structures(data, fields, header.points, wanted).columns, ""

    def _compressed(self, header: _Header, wanted: Sequence[int]) -> tuple[list[Array], str]:
        """Return the wanted columns of fields one after the other, and what is wrong with them."""
        sizes = [field.size * field.count * header.points for field in header.fields]
        starts = list(accumulate(sizes, initial=0))
        data = mapped(self.path)[header.size :]
        # Both lengths; none where the file ends before them.
        lengths = np.zeros(2, dtype="<u4")
        lengths.view(np.uint8)[: len(data[:8])] = data[:8]
        compressed, size = lengths.tolist()
        if len(data) >= 8 and size != starts[-1]:
            raise InputError(
                f"{self.path}: found {size:,} bytes of compressed points, expected {starts[-1]:,} "
                f"for {header.points:,} points"
            )
        packed = data[8 : 8 + compressed]
        plain = decompress(packed, size)
        fault = "" if len(data) < 8 + compressed else "the compressed data contradicts itself"
        columns = [plain[starts[place] : starts[place + 1]] for place in wanted]
        whole = min(
            len(column) // header.fields[place].size
            for place, column in zip(wanted, columns, strict=True)
        )
        return [
            column[: whole * header.fields[place].size].view("<" + header.fields[place].dtype)
            for place, column in zip(wanted, columns, strict=True)
        ], fault


@dataclass(frozen=True)
class _PcdField:
    """What a header says of a field."""

    name: str
    size: int
    type: str
    count: int

    @property
    def dtype(self) -> str:
        """Its numbers as numpy writes them, without byte order."""
        return f"{self.type.lower()}{self.size}"


class _Header(NamedTuple):
    """What a header says: the layout of the points, where they begin and were seen from."""

    fields: list[_PcdField]
    points: int
    position: tuple[float, float, float]
    data: str
    size: int
    notes: list[str]


def _position(viewpoint: Sequence[str]) -> tuple[float, float, float]:
    """Return the position that VIEWPOINT states; unknown where it states none, or the usual 0."""
    try:
        x, y, z = (float(word) for word in viewpoint[:3])
    except ValueError:
        return UNKNOWN_POSITION
    return (x, y, z) if any((x, y, z)) and math.isfinite(x + y + z) else UNKNOWN_POSITION
