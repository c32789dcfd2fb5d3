"""Configurations: YAML to parameters, and parameters to YAML with a comment on each.

A configuration is checked as a whole: all faults in it are reported at once, each with its file,
line and column, what was found and what would be right.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from textwrap import wrap
from typing import Any

from mlscli.config.draft import Draft, DraftPart
from mlscli.config.yaml_nodes import LocatedFault, Place, UnreadableYaml
from mlscli.errors import ConfigError, InputError, expect_items, expect_path, nearest
from mlscli.io.files import open_input
from mlscli.parameters.fields import ParameterField, fields_of, write_value
from mlscli.pipeline.parameters import (
    DEFAULT_PIPELINE,
    SECTIONS,
    Contradiction,
    Parameters,
    contradictions,
    dotted,
)
from mlscli.pipeline.stages.registry import STAGES

__all__ = ["PRESETS", "load", "loads", "preset_text", "to_yaml"]

PRESETS = ("default", "plain", "thesis")
MAX_CONFIG_BYTES = 1_000_000


def load(source: str | os.PathLike[str] | None = None, sets: Sequence[str] = ()) -> Parameters:
    """Read a configuration file or a preset.

    Parameters
    ----------
    source : str or path, optional
        The file, or the bare name of a preset (see `PRESETS`); None: all defaults.
    sets : sequence of str
        Settings ``stage.param=value`` that take precedence over the file.

    Raises
    ------
    ConfigError
        Where the file cannot be read, is too large or no UTF-8 text, or where it or a setting is
        at fault; lists every fault.
    """
    expect_items(sets, "sets", "a list of settings, such as ['map.cell_size=0.2']")
    if source is None:
        return _parameters("", None, sets)
    expect_path(source, "source", "a configuration, or the name of a preset")
    if isinstance(source, str) and source in PRESETS:
        return loads(preset_text(source), source, sets)
    return loads(_file_text(source), os.fspath(source), sets)


def loads(text: str, name: str = "configuration", sets: Sequence[str] = ()) -> Parameters:
    """Read a configuration from a text; messages call the text `name`.

    Parameters
    ----------
    text : str
        YAML.
    name : str
        What messages call it.
    sets : sequence of str
        Settings ``stage.param=value`` that take precedence over the text.

    Raises
    ------
    ConfigError
        Where the text or a setting is at fault; lists every fault.
    """
    return _parameters(text, name, sets)


def preset_text(name: str) -> str:
    """Return the text of a preset, with its comments.

    Raises
    ------
    ConfigError
        Where there is no such preset.
    """
    if name not in PRESETS:
        raise ConfigError([f"{name}: no preset of that name; {nearest(name, PRESETS)}"])
    folder: Traversable = resources.files("mlscli") / "presets"
    if not folder.is_dir():
        # In a source tree, where an editable install leads, the folder is at the root.
        folder = Path(__file__).resolve().parents[2] / "configs"
    return (folder / f"{name}.yaml").read_text(encoding="utf-8")


def _file_text(source: str | os.PathLike[str]) -> str:
    path = Path(source)
    try:
        with open_input(path) as stream:
            data = stream.read(MAX_CONFIG_BYTES + 1)
    except FileNotFoundError:
        bare = path.name == os.fspath(source) and not path.suffix
        else_ = f", nor a preset; {nearest(path.name, PRESETS)}" if bare else ""
        raise ConfigError([f"{path}: no such configuration file{else_}"]) from None
    except InputError as error:
        raise ConfigError([str(error)]) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        fault = f"{path}: cannot be read as a configuration: {reason}"
        raise ConfigError([fault]) from error
    if len(data) > MAX_CONFIG_BYTES:
        fault = f"{path}: more than {MAX_CONFIG_BYTES} bytes, which is no configuration"
        raise ConfigError([fault])
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        found = f"byte 0x{data[error.start]:02x} at offset {error.start}"
        raise ConfigError([f"{path}: {found} is not UTF-8; save it as UTF-8 text"]) from error


def _parameters(text: str, name: str | None, sets: Sequence[str]) -> Parameters:
    draft = Draft({"": Parameters, **SECTIONS}, STAGES, DEFAULT_PIPELINE)
    try:
        draft.read(text, name or "")
    except UnreadableYaml as error:
        raise ConfigError([str(error.fault)]) from error
    for setting in sets:
        draft.set(setting)
    parameters = _assemble(draft)
    whole = Place("defaults") if name is None else Place(name, 1, 1)
    for found in contradictions(parameters):
        place, path = _blame(draft, found) or whole, dotted(found.part, found.field)
        draft.fault(place, f"{path}: {found.message}")
    if draft.faults:
        ordered = sorted(draft.faults, key=_reading_order)
        # One setting can be at fault in several stages of the same name.
        raise ConfigError(list(dict.fromkeys(map(str, ordered))))
    return parameters


def _reading_order(fault: LocatedFault) -> tuple[bool, int, int]:
    """Return a sort key: faults of the file by line and column, then those of the settings."""
    return (not fault.place.line, fault.place.line, fault.place.column)


def _assemble(draft: Draft) -> Parameters:
    """Return the parameters: each as given, or else the default."""

    def values(part: DraftPart) -> dict[str, Any]:
        given = {name: each.value for name, each in part.given.items()}
        defaults = {name: item.default for name, item in fields_of(part.owner).items()}
        return defaults | dict(part.chosen) | given

    sections = {name: owner(**values(draft.sections[name])) for name, owner in SECTIONS.items()}
    stages = tuple(part.owner(**values(part)) for part in draft.pipeline)
    return Parameters(**values(draft.sections[""]), **sections, pipeline=stages)


def _blame(draft: Draft, found: Contradiction) -> Place | None:
    """Return where the parameter of a contradiction was given, otherwise where its part begins."""
    part = draft.sections[found.part] if found.stage is None else draft.pipeline[found.stage]
    given = part.given.get(found.field)
    return given.place if given else part.place


def to_yaml(parameters: Parameters) -> str:
    """Return the parameters as a configuration that reads back as the same parameters.

    Each has a comment on what it does, its unit, its range and its default.
    """
    lines = [
        "# Parameters of a map. A length is in the unit of the recording, or in cells,",
        "# as in `2 cells`.",
    ]
    lines += ["", *_commented(parameters, "")]
    for name in SECTIONS:
        lines += ["", f"{name}:", *_commented(getattr(parameters, name), "  ")]
    if not parameters.pipeline:
        return "\n".join(
            [*lines, "", "# No stages: the points become the map as they are.", "pipeline: []", ""]
        )
    lines += ["", "# The stages, in order.", "pipeline:"]
    for stage in parameters.pipeline:
        summary = (type(stage).__doc__ or "").partition("\n")[0]
        lines += [*_comment(summary, "  "), f"  - {stage.name}:", *_commented(stage, "      ")]
    return "\n".join([*lines, ""])


def _commented(part: object, indent: str) -> Iterator[str]:
    for item in fields_of(type(part)).values():
        yield from _comment(f"{item.help} ({_range(item)})", indent)
        yield f"{indent}{item.name}: {write_value(getattr(part, item.name))}"


def _comment(text: str, indent: str) -> list[str]:
    return wrap(text, 79, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _range(item: ParameterField) -> str:
    return f"{item.accepts}; default: {item.default_words}"
