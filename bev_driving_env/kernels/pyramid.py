"""Reducing the ground texture level by level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .jit import kernel


@kernel
def reduce_codes(codes: NDArray, materials: NDArray, eighths: NDArray, index: NDArray) -> NDArray:
    """Average 2 x 2 texels into one: the two commonest materials and their shares.

    Args:
        codes: (H, W) uint8.
        materials: (codes, 2) ``CODE_MATERIALS``.
        eighths: (codes,) ``CODE_EIGHTHS``.
        index: (8, 8, 9) ``CODE_INDEX``.

    Returns:
        (ceil(H / 2), ceil(W / 2)) uint8.
    """
    height, width = (codes.shape[0] + 1) // 2, (codes.shape[1] + 1) // 2
    result = np.empty((height, width), np.uint8)
    share = np.zeros(8, np.int64)
    for r in range(height):
        below = min(2 * r + 1, codes.shape[0] - 1)
        for c in range(width):
            beside = min(2 * c + 1, codes.shape[1] - 1)
            a, b = codes[2 * r, 2 * c], codes[2 * r, beside]
            d, e = codes[below, 2 * c], codes[below, beside]
            if a == b and a == d and a == e:
                result[r, c] = a
                continue
            share[:] = 0
            for code in (a, b, d, e):
                share[materials[code, 0]] += 8 - eighths[code]
                share[materials[code, 1]] += eighths[code]
            first = 0
            for m in range(1, 8):
                if share[m] > share[first]:
                    first = m
            second = 0 if first else 1
            for m in range(8):
                if m != first and share[m] > share[second]:
                    second = m
            total = share[first] + share[second]
            part = (8 * share[second] + total // 2) // total
            result[r, c] = index[first, second, part]
    return result
