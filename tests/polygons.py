"""Convex polygons, as an oracle for the kernels."""

import numpy as np


def overlap(one, other):
    """Whether two convex polygons (K, 2) overlap, by separating axes."""
    for corners in (one, other):
        edges = np.roll(corners, -1, axis=0) - corners
        for x, y in edges:
            axis = np.array([-y, x])
            a, b = one @ axis, other @ axis
            if a.max() < b.min() or b.max() < a.min():
                return False
    return True
