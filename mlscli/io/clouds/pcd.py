"""PCD files, those of the Point Cloud Library, as clouds.

Each line of the header is a keyword and its values, from ``VERSION`` to ``DATA``: ``FIELDS``, and
for each its ``SIZE`` in bytes, ``TYPE`` (F, I, U) and ``COUNT``; ``WIDTH``, ``HEIGHT``, ``POINTS``
and ``VIEWPOINT``. The points follow as rows (``ascii``), as records (``binary``), or field by field
and compressed (``binary_compressed``). Numbers in a text are read in float64, whatever their
``TYPE``.

``VIEWPOINT`` is the pose from which the points were measured. Its position is taken as that of the
craft, in the frame of the points; a position of zeros, the usual value, means that it is not known.
Its orientation is not used: the points are not moved, as in the Point Cloud Library.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

from mlscli.errors import InputError
from mlscli.io.clouds.number_lines import ALL, Item, open_lines, put_together
from mlscli.io.clouds.pcdcompressed import Packed, unpack
from mlscli.io.clouds.pointfile import Content, PointFile, by_keyframe, counted, wanted_fields
from mlscli.io.clouds.structures import Member, bytes_of, read_structures
from mlscli.io.files import open_input
from mlscli.io.plausibility.halves import unveiled
from mlscli.io.source import side_by_side
from mlscli.keyframes.keyframe import UNKNOWN_POSITION
from mlscli.runtime.arrays import Array
from mlscli.words import some

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
        columns, notes, losses = read(header, wanted)
        coordinates = unveiled(columns[:3])
        points = side_by_side(coordinates.accepted(InputError))
        notes += [f"{self.path}: {coordinates.note}"] if coordinates.note else []
        clouds = by_keyframe(points, columns[3] if len(columns) > 3 else None, header.position)
        return Content(clouds, [*header.notes, *notes], losses)

    def _header(self) -> _Header:
        """Read the header.

        Raises
        ------
        InputError
            A line that is needed is missing, or a line is wrong.
        """
        with open_input(self.path) as file:
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
        described = {len(entries.get(key, names)) for key in ("SIZE", "TYPE", "COUNT")}
        if data == "ascii" and len(described) == 1 and 3 <= min(described) < len(names):
            # In a text a field needs no size: one more was added, and not to these.
            for key, usual in (("SIZE", "4"), ("TYPE", "F"), ("COUNT", "1")):
                entries[key] += [usual] * (len(names) - len(entries[key]))
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
        """Return the `count` whole numbers of an entry; the default for each if it is missing."""
        words = entries.get(key, [default] * count)
        if len(words) != count or not all(
            w.isascii() and w.isdigit() and len(w) < 19 for w in words
        ):
            found = f"{key} {' '.join(words)}"
            raise InputError(
                f"{self.path}: found {found[:60]!r}, expected {some(count, 'whole number')}"
            )
        return [int(word) for word in words]

    def _wanted(self, header: _Header) -> list[int]:
        """Return the indices of the fields x, y, z and, where there is one, of the keyframe."""
        fields = header.fields
        for field in fields:
            if field.size * field.count > _LARGEST_FIELD:
                raise InputError(
                    f"{self.path}: the field {field.name} has SIZE {field.size} and COUNT "
                    f"{field.count}, more than a point can hold"
                )
        wanted = wanted_fields(
            self.path,
            (
                field.name if field.count == 1 and field.size in _SIZES.get(field.type, ()) else ""
                for field in fields
            ),
        )
        if wanted is None:
            names = ", ".join(f"{f.name} ({f.type}{f.size} x {f.count})" for f in fields)
            raise InputError(
                f"{self.path}: has the FIELDS {names or 'none'}, expected one number x, y and z"
            )
        return wanted

    def _rows(
        self, header: _Header, wanted: Sequence[int]
    ) -> tuple[list[Array], list[str], list[str]]:
        """Return the wanted columns of a text, notes and losses."""
        starts = list(accumulate((field.count for field in header.fields), initial=0))

        def pick(row: Sequence[Item], /) -> list[Item]:
            return [row[starts[place]] for place in wanted]

        with open_lines(self.path, header.size) as rows:
            declared = rows.read(header.points, pick, starts[-1], last=True)
            beyond = rows.read(ALL, pick, starts[-1], last=True)
        return put_together(self.path, declared, beyond, header.points, len(wanted))

    def _records(
        self, header: _Header, wanted: Sequence[int]
    ) -> tuple[list[Array], list[str], list[str]]:
        """Return the wanted columns of binary records, notes and losses."""
        fields = [
            Member(field.name, field.dtype if place in wanted else f"V{field.size * field.count}")
            for place, field in enumerate(header.fields)
        ]
        data = bytes_of(self.path)[header.size :]
        columns = read_structures(data, fields, None, wanted).columns
        return counted(self.path, columns, header.points)

    def _compressed(
        self, header: _Header, wanted: Sequence[int]
    ) -> tuple[list[Array], list[str], list[str]]:
        """Return the wanted columns of compressed points that are not damaged, notes and losses."""
        fields = [
            Packed(field.size * field.count, "<" + field.dtype if place in wanted else "")
            for place, field in enumerate(header.fields)
        ]
        data = bytes_of(self.path)[header.size :]
        columns, kept, damage = unpack(self.path, data, fields, wanted, header.points)
        columns, notes, losses = counted(self.path, columns, header.points)
        if damage:
            kept = kept[: len(columns[0])]
            columns = [column[kept] for column in columns]
        return columns, notes, losses + damage


@dataclass(frozen=True)
class _PcdField:
    """A field as the header declares it.

    Attributes
    ----------
    name : str
    size : int
        Size of one number, in bytes.
    type : str
        F, I or U.
    count : int
        How many numbers it has.
    """

    name: str
    size: int
    type: str
    count: int

    @property
    def dtype(self) -> str:
        """The numpy type of one number, without byte order."""
        return f"{self.type.lower()}{self.size}"


class _Header(NamedTuple):
    """The content of a header.

    Attributes
    ----------
    fields : list of _PcdField
        In the order of the file.
    points : int
        Number of points that are declared.
    position : tuple of float
        x, y, z from which they were measured; NaN where not known.
    data : str
        How they are stored: one of `_DATA`.
    size : int
        Size of the header, in bytes.
    notes : list of str
        What the user should know about how the file is read.
    """

    fields: list[_PcdField]
    points: int
    position: tuple[float, float, float]
    data: str
    size: int
    notes: list[str]


def _position(viewpoint: Sequence[str]) -> tuple[float, float, float]:
    """Return the position in VIEWPOINT; unknown where it is missing, not finite or all zero."""
    try:
        x, y, z = (float(word) for word in viewpoint[:3])
    except ValueError:
        return UNKNOWN_POSITION
    return (x, y, z) if any((x, y, z)) and math.isfinite(x + y + z) else UNKNOWN_POSITION
