"""How uncertain the heights of patches are: the variances of their errors.

The errors of a patch's points have two parts. What the stages on points tell is shared: they give
each point a height that follows from its neighbours, which the other points of the patch have, too,
so that it does not average out. Its variance is `noise`, the mean over the points. The rest is
their own: `variance`, how far they lie apart, divided by how many they are. Few points tell little
of that, so that it counts as if there were one more, `_PRIOR` times as far off as `noise` has it.

- The height of a horizontal patch is the mean of its points:
  ``noise + (variance + _PRIOR * noise / count) / count``.
- That of a vertical patch is the top of its points, and what it belongs to may end above them. Of n
  points spread evenly the mean square of that is ``2 * extent**2 / ((n + 1) * (n + 2))`` (H. A.
  David and H. N. Nagaraja, *Order Statistics*, 2003, doi:10.1002/0471722162), beside the noise.
- Where a stage has moved the height, the square of how far is added.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Array, Float32, Float64
from mlscli.runtime.kernels import kernel

# Chosen by benchmarks/uncertainty.py.
_PRIOR = 4.0


@kernel
def height_variances(
    height: Float64,
    depth: Float64,
    top: Float64,
    bottom: Float64,
    mean: Float64,
    variance: Float64,
    noise: Float32,
    count: Array,
) -> Float64:
    """Return the variances of the errors of patches' heights, float64 (P,); NaN: not known.

    Parameters
    ----------
    height, depth, top, bottom, mean, variance : float64 (P,)
    noise : float32 (P,)
    count : uint32 (P,)
        As in `SurfaceMap`.
    """
    variances = np.empty(len(height))
    for i in range(len(height)):
        points, shared = float(count[i]), float(noise[i])
        if depth[i] > 0.0:
            extent, moved = top[i] - bottom[i], height[i] - top[i]
            own = 2.0 * extent * extent / ((points + 1.0) * (points + 2.0))
        else:
            moved = height[i] - mean[i]
            own = (variance[i] + _PRIOR * shared / max(points, 1.0)) / max(points, 1.0)
        variances[i] = shared + own + moved * moved
    return variances
