"""`mls build --dry-run`: what the build would do, as text or JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report
from mlscli.commands.options import PARTLY_READ, say, tell, warn
from mlscli.errors import with_options
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.building.builder import Follower
    from mlscli.pipeline.parameters import Parameters


def report_build(
    target: str,
    sources: Sequence[str],
    parameters: Parameters,
    follow: Follower | None,
    selection: dict[str, Any],
    *,
    as_json: bool,
) -> int:
    """Print what a build of these sources would do, and return the exit status.

    Parameters
    ----------
    target : str
        The map's file, which is not written.
    sources : sequence of str
        The recording's files.
    parameters : Parameters
        Those of the map.
    follow : callable or None
        As `mlscli.trials.estimate.estimate_build` takes it.
    selection : dict
        The options of `mlscli.open_recording`.
    as_json : bool
        Whether to print JSON or text.
    """
    from mlscli.trials.estimate import estimate_build

    estimate = estimate_build(*sources, parameters=parameters, follow=follow, **selection)
    account = {"map": target, "mode": parameters.mode, **asdict(estimate)}
    size = estimate.cell_size
    account["vehicle"] = None if size is None else parameters.vehicle.in_units(size)
    account["notes"] = [with_options(note) for note in estimate.notes]
    for note in estimate.notes:
        say(f"mls: {note}")
    for loss in estimate.lost:
        warn(f"mls: warning: {loss}")
    click.echo(json.dumps(account, indent=2)) if as_json else tell(_text(account, parameters))
    return PARTLY_READ if estimate.lost else 0


def _text(account: dict[str, Any], parameters: Parameters) -> str:
    auto = parameters.map.cell_size == "auto"
    gap_varies = parameters.map.gap_size == "auto" or (
        auto and not isinstance(parameters.map.gap_size, int | float)
    )
    read, why = account["read"], account["sizes"]
    about = "" if read["all"] else "about "
    cell_size = _number(account["cell_size"], about if auto else "")
    gap_size = _number(account["gap_size"], about if gap_varies else "")
    rows = [
        ("clouds", ", ".join(account["clouds"])),
        ("frame", account["frame_id"]),
        ("up", account["up"]),
        ("keyframes", _keyframes(account, about)),
        ("points", _number(account["points"], about)),
        ("patches", _number(account["patches"], "" if account["whole"] else "about ")),
        ("free space", _free_space(account, parameters)),
        ("cell size", report.reasoned(cell_size, why.get("cell_size"))),
        ("gap size", report.reasoned(gap_size, why.get("gap_size"))),
        ("noise", why.get("noise", "")),
        ("vehicle", report.craft(parameters.vehicle, None if auto else account["cell_size"])),
        ("time", _duration(account["seconds"])),
        ("judged by", _judged_by(read)),
        ("dropped", report.counts(read["dropped"])),
    ]
    return f"{account['map']}: not written\n{report.lines(rows)}"


_UNKNOWN = "not known from the beginning of the recording"


def _free_space(account: dict[str, Any], parameters: Parameters) -> str:
    if not parameters.map.free_space:
        return ""
    number = _number(account["voxels"], "" if account["whole"] else "about ")
    return number if account["voxels"] is None else f"{number} voxels seen through"


def _keyframes(account: dict[str, Any], about: str) -> str:
    if account["keyframes"] is None:
        return _UNKNOWN
    number = _number(account["keyframes"], "" if account["counted"] else "about ")
    if account["batches"] is None:
        return number
    return f"{number} in {about}{some(account['batches'], 'batch')}, {account['mode']}"


def _number(number: float | None, about: str) -> str:
    if number is None:
        return _UNKNOWN
    if isinstance(number, int):
        # An extrapolation has two good digits at most.
        return f"{about}{int(float(f'{number:.1e}')) if about else number:,}"
    return f"{number:.6g}" if not about else f"about {number:.2g}"


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return _UNKNOWN
    if seconds < 100:
        return f"about {seconds:.2g} s"
    return f"about {seconds / 60:.0f} min" if seconds < 6000 else f"about {seconds / 3600:.1f} h"


def _judged_by(read: dict[str, Any]) -> str:
    of = "all" if read["all"] else "the first"
    keyframes = some(read["keyframes"], "keyframe")
    return f"{of} {keyframes}, {some(read['points'], 'point')}"
