"""How a map lies in the frame of another of the same place: yaw, scale and shift, or why not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from types import NoneType
from typing import Any

import numpy as np

from mlscli.aligning.evidence import Evidence, samples_of
from mlscli.aligning.refine import refined
from mlscli.aligning.search import SCALES, Pair, search
from mlscli.errors import InputError, UsageError, expect
from mlscli.geometry.similarity import Similarity
from mlscli.maps.surface_map import SurfaceMap

LEAST_EVIDENCE = 40.0
"""A fit for which less speaks, in nats, may be chance."""

LEAST_AGREEMENT = 0.75
"""Of what both maps can judge, at least this share must agree."""

MOST_RIVAL = 0.9
"""A fit is one of several where another has more than this share of its evidence."""

MOST_APART = 3.0
"""Where the scale is searched, the first map must fit onto the second as the second onto the first,
within so many cells: rooms fit well into larger ones, but only one way round."""

# How far a fit is shifted and turned to see if it could as well be there, in voxels.
_ASIDE = 3.0
_FEWEST = 30


@dataclass(frozen=True)
class Alignment:
    """How a map lies in the frame of another.

    Attributes
    ----------
    fit : Similarity
        From the frame of the second map to that of the first.
    evidence : float
        What speaks for it, in nats.
    rival : float
        What speaks for the next best fit, or for the same a few cells aside, as a share of that.
    agreement : float
        The share of the surfaces in cells that both have measured which lie on those of the other
        map, within about a cell; of both maps the lower share.
    overlap : float
        The share of the surfaces in cells that the other map has measured, too; of both maps the
        higher share.
    rms : float
        Of the distances between floors that lie on each other, in the unit of the first map.
    """

    fit: Similarity
    evidence: float
    rival: float
    agreement: float
    overlap: float
    rms: float

    def to_dict(self) -> dict[str, Any]:
        """Return all of it, ready for JSON: yaw in degrees."""
        fit = self.fit
        told = {"yaw": math.degrees(fit.yaw), "scale": fit.scale, "shift": list(fit.shift)}
        measures = ("evidence", "rival", "agreement", "overlap", "rms")
        return told | {name: getattr(self, name) for name in measures}


def align_maps(one: SurfaceMap, other: SurfaceMap, scale: float | None = None) -> Alignment:
    """Find how a map lies in the frame of another, by their measured surfaces alone.

    No first guess is needed. Both maps must have z up. Scales are searched from a third to three
    times that at which both are equally wide.

    Parameters
    ----------
    one, other : SurfaceMap
    scale : float, optional
        What a length of the second map is in the unit of the first, where that is known.

    Raises
    ------
    TypeError
        Where an argument is of another type.
    UsageError
        Where the scale is not above 0.
    InputError
        Where too little is measured, nothing fits, or more than one fit is about as good.
    """
    expect(one, SurfaceMap, "one", "a map (SurfaceMap)")
    expect(other, SurfaceMap, "other", "a map (SurfaceMap)")
    expect(scale, (Real, NoneType), "scale", "a number above 0")
    if scale is not None and not 0 < scale < math.inf:
        raise UsageError(f"`scale` {scale!r}: expected a number above 0")
    samples, others = samples_of(one), samples_of(other)
    for points, name in ((samples, "first"), (others, "second")):
        if len(points) < _FEWEST:
            raise InputError(
                f"the {name} map has too few measured patches to be aligned by: {len(points)} "
                f"places on them, of at least {_FEWEST}"
            )
    pair = Pair.of(samples, others, (one.cell_size, other.cell_size))
    best, *more = search(pair, scale)
    fit, rms = refined(pair, best.fit, best.width, scale is None)
    evidence = Evidence.of(pair.one, pair.other, best.width, fit.scale)
    speaking = evidence.total(fit) * (best.width / one.cell_size) ** 2
    both = [
        field.agreement(points)
        for field, points in (
            (evidence.one, fit.points(evidence.other.middles)),
            (evidence.other, fit.inverse.points(evidence.one.middles)),
        )
    ]
    agreement = min(float(on.sum() / max(1, judged.sum())) for judged, on in both)
    overlap = max(float(judged.mean()) for judged, _ in both)
    if speaking < LEAST_EVIDENCE or agreement < LEAST_AGREEMENT:
        raise InputError(
            f"nothing fits well enough to be trusted: of the best fit, {_told(fit, pair)}, "
            f"{agreement:.0%} of what both have measured agrees (at least {LEAST_AGREEMENT:.0%}), "
            f"and {max(speaking, 0):.0f} nats speak for it (at least {LEAST_EVIDENCE:.0f})"
            f"{_scales(scale)}"
        )
    if speaking < best.evidence / 2 or not math.isfinite(rms):
        raise InputError(
            f"nothing fits well enough to be trusted: near the best fit, {_told(best.fit, pair)}, "
            f"the surfaces do not come to lie on each other{_scales(scale)}"
        )
    aside = max(map(evidence.total, _aside(fit, pair, best.width))) / evidence.total(fit)
    rival = max([aside, *(each.evidence / best.evidence for each in more)])
    if rival > MOST_RIVAL:
        second = max(more, key=lambda each: each.evidence, default=None)
        what = "it could as well lie some cells aside: too little upright is in both to hold it"
        if second is not None and second.evidence / best.evidence >= aside:
            what = (
                f"{_told(second.fit, pair)} is about as good: the place looks alike from both sides"
            )
        raise InputError(
            f"more than one fit is possible: {_told(fit, pair)}, but {what} ({rival:.0%} of the "
            f"evidence; at most {MOST_RIVAL:.0%}){_scales(scale)}"
        )
    whole = _unpivoted(fit, pair)
    if scale is None:
        back = _back(pair)
        apart = np.linalg.norm(whole.points(others) - back.points(others), axis=1).max()
        if apart > MOST_APART * one.cell_size:
            raise InputError(
                f"more than one fit is possible: {_told(fit, pair)}, but the other way round the "
                f"best is {_in_words(back)}{_scales(scale)}"
            )
    return Alignment(whole, speaking, max(rival, 0.0), agreement, overlap, rms)


def _back(pair: Pair) -> Similarity:
    """Return the way back of the best fit of the first map onto the second, of any scale."""
    reverse = Pair.of(pair.other + pair.pivot, pair.one, pair.cell_sizes[::-1])
    best = search(reverse, None)[0]
    return _unpivoted(refined(reverse, best.fit, best.width, True)[0], reverse).inverse


def _aside(fit: Similarity, pair: Pair, width: float) -> Iterator[Similarity]:
    """Yield fits a little beside another: shifted, turned, and scaled."""
    x, y, z = fit.shift
    for angle in np.arange(0, 2 * math.pi, math.pi / 8).tolist():
        step = _ASIDE * width
        shift = (x + step * math.cos(angle), y + step * math.sin(angle), z)
        yield Similarity(fit.yaw, fit.scale, shift)
    turn = _ASIDE * width / (pair.radius * fit.scale)
    for sign in (-1, 1):
        yield Similarity(fit.yaw + sign * turn, fit.scale, fit.shift)
        yield Similarity(fit.yaw, fit.scale * math.exp(sign * turn), fit.shift)


def _unpivoted(fit: Similarity, pair: Pair) -> Similarity:
    """Return a fit of points relative to the pivot as one of the points themselves."""
    x, y, z = (np.array(fit.shift) - fit.linear @ pair.pivot).tolist()
    return Similarity(math.remainder(fit.yaw, 2 * math.pi), fit.scale, (x, y, z))


def _told(fit: Similarity, pair: Pair) -> str:
    return _in_words(_unpivoted(fit, pair))


def _in_words(fit: Similarity) -> str:
    shift = ", ".join(f"{each:.3g}" for each in fit.shift)
    return f"yaw {math.degrees(fit.yaw):.1f} degrees, scale {fit.scale:.3g}, shift {shift}"


def _scales(scale: float | None) -> str:
    if scale is not None:
        return ""
    return f"; a known `scale` helps (searched are up to {SCALES:g} times that of equal width)"
