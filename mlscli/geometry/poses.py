"""Poses: where a frame stands in another; chained, inverted, interpolated, applied to points.

T_target_source takes coordinates in the frame `source` to coordinates in the frame `target`:
T_map_base and T_base_lidar chain to T_map_lidar. Rotations are unit quaternions x y z w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Bool, Float64, Int64


class Pose(NamedTuple):
    """A rigid transform: first the rotation, then the translation.

    Attributes
    ----------
    translation : float64 (3,)
        In the unit of the recording.
    rotation : float64 (4,)
        Unit quaternion x y z w.
    """

    translation: Float64
    rotation: Float64


class Poses(NamedTuple):
    """Poses at several times.

    Attributes
    ----------
    translation : float64 (M, 3)
        In the unit of the recording; NaN where not known.
    rotation : float64 (M, 4)
        Unit quaternions x y z w; NaN where not known.
    known : bool (M,)
        Whether the pose at each time is known.
    """

    translation: Float64
    rotation: Float64
    known: Bool

    @property
    def inverse(self) -> Poses:
        """T_source_target of each T_target_source."""
        rotation = self.rotation * (-1.0, -1.0, -1.0, 1.0)
        return Poses(-_rotated(rotation, self.translation), rotation, self.known)

    def chained(self, other: Poses) -> Poses:
        """Return T_a_c, where these are T_a_b and the others T_b_c; a single one is broadcast."""
        return Poses(
            self.translation + _rotated(self.rotation, other.translation),
            _product(self.rotation, other.rotation),
            self.known & other.known,
        )

    def pose(self, row: int) -> Pose:
        """Return the pose of one row."""
        return Pose(self.translation[row], self.rotation[row])


def identity(count: int) -> Poses:
    """Return T_a_a, `count` times."""
    rotation = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    return Poses(np.zeros((count, 3)), rotation, np.ones(count, dtype=np.bool_))


def unknown(count: int) -> Poses:
    """Return `count` poses that are not known."""
    none = np.zeros(count, dtype=np.bool_)
    return Poses(np.full((count, 3), np.nan), np.full((count, 4), np.nan), none)


def are_poses(stamps: Float64, translations: Float64, rotations: Float64) -> Bool:
    """Return which rows are valid poses, bool (N,): all finite, and the quaternion not 0.

    Parameters
    ----------
    stamps : float64 (N,)
        Seconds.
    translations : float64 (N, 3)
    rotations : float64 (N, 4)
        Quaternions x y z w of any length.
    """
    # A quaternion whose length overflows is none.
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(rotations, axis=1)
    finite = np.isfinite(stamps) & np.isfinite(translations).all(axis=1)
    return np.asarray(finite & np.isfinite(lengths) & (lengths > 0))


def in_order(stamps: Float64, rows: Int64) -> Int64:
    """Return rows, int64, in the order of their time stamps; of equal stamps only the last row."""
    rows = rows[np.argsort(stamps[rows], kind="stable")]
    return rows[np.diff(stamps[rows], append=np.inf) > 0]


def unit(rotations: Float64) -> Float64:
    """Return quaternions (N, 4) scaled to length 1."""
    return np.asarray(rotations / np.linalg.norm(rotations, axis=1, keepdims=True))


def matrices(rotations: Float64) -> Float64:
    """Return quaternions (N, 4), x y z w of any length above 0, as matrices (N, 3, 3).

    To the bit as scipy makes them, which takes a third of a second to import.
    """
    x, y, z, w = rotations.T
    x, y, z, w = rotations.T / np.sqrt(((x * x + y * y) + z * z) + w * w)
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    rows = (
        (xx - yy - zz + ww, 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), -xx + yy - zz + ww, 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), -xx - yy + zz + ww),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def looking(yaw: Float64, tilt: Float64) -> Float64:
    """Return the attitudes of a craft whose camera looks somewhere, unit quaternions (K, 4).

    The craft's axes are x ahead, y left, z up. Its camera is fixed to it and looks along -z.

    Parameters
    ----------
    yaw, tilt : float64 (K,)
        Where it looks, in radians: from x towards y; how far up from straight down, 0 to pi. The
        craft heads along the yaw, its nose up by the tilt.
    """
    yaw, pitch = yaw / 2, -tilt / 2
    cos_yaw, sin_yaw, cos_pitch, sin_pitch = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.column_stack(
        (-sin_yaw * sin_pitch, cos_yaw * sin_pitch, sin_yaw * cos_pitch, cos_yaw * cos_pitch)
    )


def looks_of(attitudes: Float64) -> tuple[Float64, Float64]:
    """Return where cameras look, `yaw` and `tilt` of `looking`, of attitudes (K, 4)."""
    rotation = matrices(attitudes)
    ahead, looks = rotation[:, :, 0], -rotation[:, :, 2]
    level = np.hypot(looks[:, 0], looks[:, 1])
    # Where it looks straight down, its nose says where ahead is.
    x, y = np.where(level[:, None] > 1e-6, looks[:, :2], ahead[:, :2]).T
    return np.arctan2(y, x), np.arctan2(level, -looks[:, 2])


def apply(T_target_source: Pose, points: Float64) -> Float64:  # noqa: N803
    """Move points (N, 3) from the frame `source` into the frame `target`.

    The identity leaves every bit as it is.
    """
    translation, rotation = T_target_source
    if rotation[:3].any():
        points = turn(matrices(rotation[np.newaxis])[0], points)
    return points + translation if translation.any() else points


def turn(matrix: Float64, points: Float64) -> Float64:
    """Multiply points (N, 3) by a matrix (3, 3).

    The three products of a row are added in order, so that the sums are the same with any number
    of threads.
    """
    x, y, z = points.T
    # A coordinate that is not finite may spoil the others of its point, which is dropped later.
    with np.errstate(invalid="ignore", over="ignore"):
        return np.stack([(a * x + b * y) + c * z for a, b, c in matrix.tolist()], axis=1)


GAP, GAP_PERIODS = 10.0, 3.0
"""Poses farther apart than so many seconds and so many periods have a gap between them.

Ten seconds is how long tf2 keeps transforms by default, so no node has interpolated across more.
"""


class PoseTrack:
    """Poses over time: linear between them for translations, slerp for rotations.

    The first pose also holds for half a period before it, and the last for half a period after it;
    a period is the median spacing of the time stamps. Beyond that no pose is known. A single pose
    has no period and is known at its own time stamp only. Nothing is interpolated across a gap, a
    spacing of more than `gap`: its ends are like those of the whole.

    Parameters
    ----------
    stamps : float64 (N,)
        Seconds, in any order. Of equal ones the last counts.
    translations : float64 (N, 3)
        In the unit of the recording.
    rotations : float64 (N, 4)
        Quaternions x y z w of any length but 0; q and -q are the same.
    series : int64 (N,), optional
        Nothing is interpolated between poses of different series: the earlier pose holds until
        the later one. By default all are of one series.
    gap : float, optional
        The longest spacing (s) that is no gap; by default `GAP`, or `GAP_PERIODS` periods where
        that is more, as keyframes may come seldom.

    Attributes
    ----------
    stamps : float64 (M,)
        Time stamps of the valid poses (see `are_poses`), ascending, each once.
    """

    def __init__(
        self,
        stamps: Float64,
        translations: Float64,
        rotations: Float64,
        series: Int64 | None = None,
        gap: float | None = None,
    ) -> None:
        rows = in_order(stamps, np.flatnonzero(are_poses(stamps, translations, rotations)))
        self.stamps = stamps[rows]
        self._translations = translations[rows]
        self._rotations = unit(rotations[rows])
        self._series = np.zeros(len(rows), dtype=np.int64) if series is None else series[rows]
        period = float(np.median(np.diff(self.stamps))) if len(rows) > 1 else 0.0
        self._slack = period / 2
        self._gap = max(GAP, GAP_PERIODS * period) if gap is None else gap
        first, last = (self.stamps[0], self.stamps[-1]) if len(rows) else (1.0, 0.0)
        self._span = (first - self._slack, last + self._slack) if len(rows) else (1.0, 0.0)

    def at(self, stamps: Float64) -> Poses:
        """Return the pose at each of these times (M,), in seconds; at NaN none is known."""
        if not len(self.stamps):
            return unknown(len(stamps))
        low, high, share, in_gap = self._share(stamps)
        known = (stamps >= self._span[0]) & (stamps <= self._span[1]) & ~in_gap
        share = np.where(known, self._within_series(low, high, share), np.nan)[:, np.newaxis]
        translation = (1 - share) * self._translations[low] + share * self._translations[high]
        return Poses(translation, _slerp(self._rotations[low], self._rotations[high], share), known)

    def in_gap(self, stamps: Float64) -> Bool:
        """Return whether each of these times (M,) lies in a gap, where no pose is known."""
        if not len(self.stamps):
            return np.zeros(len(stamps), dtype=np.bool_)
        return self._share(stamps)[3]

    def series_at(self, stamps: Float64) -> Int64:
        """Return the series of the pose in force at each of these times (M,), known or not.

        There must be at least one pose.
        """
        low, high, share, _ = self._share(stamps)
        share = self._within_series(low, high, share)
        return np.where(share == 1, self._series[high], self._series[low])

    def _within_series(self, low: Int64, high: Int64, share: Float64) -> Float64:
        return np.where(self._series[low] == self._series[high], share, share == 1)

    def _share(self, stamps: Float64) -> tuple[Int64, Int64, Float64, Bool]:
        """Return the rows before and after each time (M,), its share of the way, and what is apart.

        The share is from 0 to 1, whatever the series. Apart is what lies in a gap.
        """
        last = len(self.stamps) - 1
        # Often there is one time only: functions of numpy's that are written in Python cost most.
        low = np.searchsorted(self.stamps, stamps, side="right") - 1
        low = np.minimum(np.maximum(low, 0), max(0, last - 1))
        high = np.minimum(low + 1, last)
        before, after = self.stamps[low], self.stamps[high]
        step = after - before
        share = np.minimum(np.maximum((stamps - before) / np.where(step > 0, step, 1.0), 0.0), 1.0)
        apart = step > self._gap
        if apart.any():
            share = np.where(apart & (stamps - before <= self._slack), 0.0, share)
            share = np.where(apart & (after - stamps <= self._slack), 1.0, share)
        return low, high, share, np.asarray(apart & (share > 0) & (share < 1))


def _slerp(begin: Float64, end: Float64, share: Float64) -> Float64:
    """Interpolate between unit quaternions (M, 4), the short way; `share` (M, 1) is 0 to 1."""
    end = np.where(_dot(begin, end) < 0, -end, end)
    difference, total = end - begin, end + begin
    angle = 2 * np.arctan2(np.sqrt(_dot(difference, difference)), np.sqrt(_dot(total, total)))
    sine = np.sin(angle)
    same = sine == 0
    sine = np.where(same, 1.0, sine)
    rest = np.where(same, 1 - share, np.sin((1 - share) * angle) / sine)
    return rest * begin + np.where(same, share, np.sin(share * angle) / sine) * end


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("...i,...i->...", a, b))[..., np.newaxis]


def _product(a: Float64, b: Float64) -> Float64:
    """Multiply quaternions x y z w."""
    (u, s), (v, t) = _parts(a), _parts(b)
    return np.concatenate((s * v + t * u + _cross(u, v), s * t - _dot(u, v)), axis=-1)


def _rotated(rotation: Float64, vectors: Float64) -> Float64:
    """Rotate vectors by unit quaternions."""
    axis, real = _parts(rotation)
    across = 2 * _cross(axis, vectors)
    return vectors + real * across + _cross(axis, across)


def _parts(quaternions: Float64) -> tuple[Float64, Float64]:
    return quaternions[..., :3], quaternions[..., 3:]


def _cross(a: Float64, b: Float64) -> Float64:
    # np.cross takes five times as long for a single product.
    after, before = [1, 2, 0], [2, 0, 1]
    return a[..., after] * b[..., before] - a[..., before] * b[..., after]
