"""The types, range and meaning of parameters, declared by the fields of dataclasses."""

from __future__ import annotations

import math
import re
from dataclasses import MISSING, dataclass, field, fields
from inspect import get_annotations
from numbers import Integral, Real
from typing import Any, Literal, get_args, get_origin, get_type_hints

from mlscli.errors import shorten
from mlscli.parameters.lengths import Cells, Length, longest, shortest

# Beyond this, whole numbers are not exact in float64, nor in JSON as many programs read it.
MAX_INTEGER = 2**53
_CELLS = re.compile(r"([-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?)\s+cells?")
_FIELDS: dict[type, dict[str, ParameterField]] = {}


# Stands for an invalid value. Ordering comparisons with it fail, so that nothing is concluded.
UNKNOWN: Any = object()


def parameter(
    default: Any,
    help: str,  # noqa: A002
    *,
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    default_from: str | None = None,
    at_least: Length | None = None,
    at_most: Length | None = None,
) -> Any:
    """Declare a field of a parameter dataclass; the configuration's schema follows from it.

    Parameters
    ----------
    default : object
        The value where none is given.
    help : str
        What the parameter does, in one line, with its unit.
    low, high : float, optional
        The least and the greatest value allowed, inclusive; of a length in cells, its number.
    above : float, optional
        A bound that the value must exceed.
    default_from : str, optional
        Another parameter whose value it takes where none is given, that is, where it is None: one
        of a section, such as ``vehicle.width``, or, by its bare name, one of the same part.
    at_least, at_most : float or Cells, optional
        The least and the greatest length that it takes from there.
    """
    metadata = {
        "help": help,
        "low": low,
        "high": high,
        "above": above,
        "default_from": default_from,
        "at_least": at_least,
        "at_most": at_most,
    }
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class ParameterField:
    """A parameter as its dataclass declares it.

    Attributes
    ----------
    name, help : str
        The name of the parameter, and what it does.
    kinds : frozenset of type
        The types of value allowed, among bool, int, float, Cells and NoneType.
    words : tuple of str
        The words allowed.
    default : object
        The value where none is given.
    default_from : str or None
        The parameter whose value it takes where it is None.
    at_least, at_most : float, Cells or None
        The least and the greatest length that it takes from there.
    low, high : float or None
        The least and the greatest value allowed, inclusive.
    above : float or None
        A bound that the value must exceed.
    """

    name: str
    help: str
    kinds: frozenset[type]
    words: tuple[str, ...]
    default: Any
    default_from: str | None
    at_least: Length | None
    at_most: Length | None
    low: float | None
    high: float | None
    above: float | None

    @property
    def default_words(self) -> str:
        """What holds where no value is given, in words."""
        if self.default_from is None or self.default is not None:
            return write_value(self.default)
        bounds = {"at least": self.at_least, "at most": self.at_most}
        named = [f", {how} {write_value(bound)}" for how, bound in bounds.items() if bound]
        return "".join([self.default_from, *named])

    def following(self, value: Any, cell_size: float | None) -> Any:
        """Return what the parameter becomes where it is not given and `default_from` has a value.

        Parameters
        ----------
        value : object
            The value of that parameter.
        cell_size : float or None
            Side of a cell, in the unit of the recording; None: not yet known.

        Returns
        -------
        object
            None where the size of a cell decides and is not known, or the value is at fault itself.
        """
        if value is None or not self.allows(value):
            return None
        if self.at_least is not None:
            value = longest(value, self.at_least, cell_size)
        if value is not None and self.at_most is not None:
            value = shortest(value, self.at_most, cell_size)
        return value

    @property
    def accepts(self) -> str:
        """The values allowed, in words."""
        limits = []
        if self.above is not None:
            limits.append(f"above {self.above:g}")
        if self.low is not None:
            limits.append(f"of at least {self.low:g}")
        if self.high is not None:
            limits.append(f"{'and' if limits else 'of'} at most {self.high:g}")
        kinds = list(self.words)
        if bool in self.kinds:
            kinds += ["true", "false"]
        if int in self.kinds:
            kinds.append(" ".join(["a whole number", *limits]))
        elif Cells in self.kinds:
            kinds.append(" ".join(["a length", *limits]) + ", as a number or N cells,")
        elif float in self.kinds:
            kinds.append(" ".join(["a number", *limits]))
        if type(None) in self.kinds:
            kinds.append("null")
        return " or ".join(kinds).removesuffix(",")

    def convert(self, value: object) -> Any:
        """Convert a value from YAML to a value of the parameter.

        Raises
        ------
        ValueError
            Where the value is of a wrong type or out of range; says what was found and what is
            allowed.
        """
        if isinstance(value, str) and Cells in self.kinds:
            match = _CELLS.fullmatch(value.strip())
            value = Cells(float(match[1]) + 0.0) if match else value
        elif float in self.kinds and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 10**300 else math.inf
        elif isinstance(value, float):
            value += 0.0
        self.check(value)
        return value

    def check(self, value: object) -> None:
        """Raise ValueError where a value is of a wrong type or out of range, as `convert` does."""
        if not self.allows(value):
            length = isinstance(value, Cells) or (type(value) is float and float in self.kinds)
            found = write_value(value) if length else describe_value(value)
            raise ValueError(f"found {found}; expected {self.accepts}")

    def allows(self, value: object) -> bool:
        """Return whether a value is of an allowed type and in range."""
        if value is None or isinstance(value, bool):
            return type(value) in self.kinds
        if isinstance(value, str):
            return value in self.words
        if isinstance(value, Cells):
            return Cells in self.kinds and self._in_range(value.count)
        if isinstance(value, Integral):
            return not self.kinds.isdisjoint({int, float}) and self._in_range(int(value))
        return isinstance(value, Real) and float in self.kinds and self._in_range(float(value))

    def _in_range(self, number: float) -> bool:
        return (
            math.isfinite(number)
            and (int not in self.kinds or abs(number) <= MAX_INTEGER)
            and (self.above is None or number > self.above)
            and (self.low is None or number >= self.low)
            and (self.high is None or number <= self.high)
        )


def fields_of(owner: type) -> dict[str, ParameterField]:
    """Return the parameters of a dataclass by name, its own before those that it inherits."""
    if owner not in _FIELDS:
        _FIELDS[owner] = _declared(owner)
    return _FIELDS[owner]


def _declared(owner: type) -> dict[str, ParameterField]:
    hints = get_type_hints(owner)

    def generation(name: str) -> int:
        return next(n for n, base in enumerate(owner.__mro__) if name in get_annotations(base))

    return {
        item.name: _field(item.name, item.default, hints[item.name], item.metadata)
        for item in sorted(fields(owner), key=lambda item: generation(item.name))
        if "help" in item.metadata
    }


def _field(name: str, default: Any, hint: Any, metadata: Any) -> ParameterField:
    alternatives = (hint,) if get_origin(hint) is Literal else get_args(hint) or (hint,)
    words: list[str] = []
    kinds: set[type] = set()
    for alternative in alternatives:
        if get_origin(alternative) is Literal:
            words += get_args(alternative)
        else:
            kinds.add(alternative)
    return ParameterField(
        name=name,
        kinds=frozenset(kinds),
        words=tuple(words),
        default=None if default is MISSING else default,
        **metadata,
    )


def write_value(value: object) -> str:
    """Return a value as YAML that reads back as the same value."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Cells):
        return f"{_number(value.count)} {'cell' if value.count == 1 else 'cells'}"
    return _number(value) if isinstance(value, Real) else str(value)


def json_value(value: object) -> Any:
    """Return a value as JSON can hold it: lengths as numbers or ``N cells``."""
    if isinstance(value, Cells):
        return write_value(value)
    if isinstance(value, Real) and not isinstance(value, bool):
        return int(value) if isinstance(value, Integral) else float(value)
    return value


def _number(value: Real | float) -> str:
    if isinstance(value, Integral):
        return str(int(value))
    number = float(value)
    whole = number.is_integer() and abs(number) < MAX_INTEGER
    return str(int(number)) if whole else repr(number)


def describe_value(value: object) -> str:
    """Return a description of a single value, in one short line however long the value is."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return shorten(repr(value))
    return shorten(str(value))
