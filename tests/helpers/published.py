"""Sequences of clouds: a map that is published again and again, and what is none.

Each sequence is a list of float64 arrays (N, 3), rounded as float32 messages hold them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlscli.runtime.arrays import Float64

Clouds = list[Float64]


def room(points: int, seed: int = 0) -> Float64:
    """Return points of a room of 8 x 6 x 3 with a block in it, in the order of their x, about."""
    rng = np.random.default_rng(seed)
    size = np.array([8.0, 6.0, 3.0])
    xyz = rng.uniform(0, 1, (points, 3)) * size
    side = rng.integers(0, 6, points)
    rows = np.arange(points)
    xyz[rows, side // 2] = size[side // 2] * (side % 2)
    block = rng.random(points) < 0.15
    xyz[block] = rng.uniform((1, 1, 1), (2.5, 3, 1), (int(block.sum()), 3))
    xyz += rng.normal(0, 0.01, xyz.shape)
    return np.asarray(xyz[np.argsort(xyz[:, 0] + rng.normal(0, 0.4, points))])


def published(
    messages: int,
    lifted: Callable[[float], float],
    *,
    points: int = 3000,
    grows: bool = True,
    shuffled: bool = False,
    culled: float = 0.0,
    jitter: float = 0.0,
    seed: int = 0,
) -> Clouds:
    """Return a map as it is published again and again.

    Parameters
    ----------
    messages : int
    lifted : callable
        Returns by how much the whole map lies too high, given the time from 0 to 1.
    points : int
        Of the last message.
    grows : bool
        Whether the first message has only the first of these points, and each a few more.
    shuffled : bool
        Whether the points of each message have an order of their own.
    culled : float
        The share of points that vanish again, each at some time.
    jitter : float
        The deviation by which each coordinate of each message is off.
    seed : int
    """
    rng = np.random.default_rng(seed)
    whole = room(points, seed)
    dies = np.where(rng.random(points) < culled, rng.random(points), np.inf)
    clouds = []
    for number in range(messages):
        time = number / max(messages - 1, 1)
        size = points * (number + 1) // messages if grows else points
        cloud = (whole + rng.normal(0, jitter, whole.shape))[:size]
        cloud[:, 2] += lifted(time)
        cloud = cloud[dies[:size] >= time]
        clouds.append(_single(rng.permutation(cloud) if shuffled else cloud))
    return clouds


def scans(
    messages: int,
    stands: Callable[[float], Float64],
    *,
    noise: float,
    lines: int = 24,
    columns: int = 240,
    seed: int = 0,
) -> Clouds:
    """Return scans of a room of 10 x 7 x 3.5, in its frame.

    Parameters
    ----------
    messages : int
    stands : callable
        Returns where the scanner is, (3,), given the time from 0 to 1.
    noise : float
        Deviation of the ranges.
    lines, columns : int
        How many rays there are.
    seed : int
    """
    rng = np.random.default_rng(seed)
    up, around = np.meshgrid(
        np.radians(np.linspace(-28, 18.1, lines)),
        np.arange(columns) * 2 * np.pi / columns + 1e-3,  # along no axis
        indexing="ij",
    )
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    rays = rays.reshape(-1, 3)
    size = np.array([10.0, 7.0, 3.5])
    clouds = []
    for number in range(messages):
        origin = stands(number / max(messages - 1, 1))
        ranges = (np.where(rays > 0, size - origin, -origin) / rays).min(axis=1)
        ranges += rng.normal(0, noise, len(rays))
        clouds.append(_single(origin + rays * ranges[:, None]))
    return clouds


def _single(points: Float64) -> Float64:
    return np.asarray(points.astype(np.float32).astype(np.float64))
