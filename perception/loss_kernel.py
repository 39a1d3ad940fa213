"""BCE and Dice of planes with their gradient, in one kernel for the CPU.

The loops are written so that the compiler turns them into vector instructions: exponential and
logarithm as polynomials, no branches, partial sums in lanes. Loss and gradient are within 1e-6
of the exact ones for any finite logit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.kernels.jit import kernel

LANES = 16
BLOCK = 2048  # pixels; the work arrays of a block stay in the fastest cache

# float32 throughout: a Python constant would widen the loops to float64
_ZERO, _HALF, _ONE, _TWO = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
_LOWEST = np.float32(-87)  # exp() of less is no normal float32
_LOG2_E, _LN_2 = np.float32(1.4426950408889634), np.float32(0.6931471805599453)
# Taylor's coefficients of exp(r) for |r| <= log(2) / 2, highest first
_E7, _E6, _E5 = np.float32(1 / 5040), np.float32(1 / 720), np.float32(1 / 120)
_E4, _E3 = np.float32(1 / 24), np.float32(1 / 6)
# those of artanh(s) / s in s^2, for s <= 1/3
_A13, _A11, _A9 = np.float32(1 / 13), np.float32(1 / 11), np.float32(1 / 9)
_A7, _A5, _A3 = np.float32(1 / 7), np.float32(1 / 5), np.float32(1 / 3)


@kernel
def bce_dice_planes(
    logits: NDArray[np.float32],  # (P, n)
    target: NDArray[np.uint8],  # (P, n), 0 or 255
    scale: NDArray[np.float32],  # (P,) what each plane counts in the total loss
    dice: NDArray[np.float32],  # (P,) what Dice counts beside BCE
    gradient: NDArray[np.float32],  # out: (P, n) of the total loss, or (0, 0): not wanted
    losses: NDArray[np.float64],  # out: (P,) of each plane, without its scale
) -> bool:
    """Fill in losses and gradient; False if the target holds anything but 0 and 255."""
    planes, pixels = logits.shape
    wanted = gradient.size > 0
    probability = np.empty(pixels, np.float32)
    work = np.empty(BLOCK, np.float32)
    lanes = np.empty(LANES, np.float32)
    strange = np.uint8(0)
    for k in range(planes):
        bce, sum_p, sum_pt, sum_t = 0.0, 0.0, 0.0, 0
        for first in range(0, pixels, BLOCK):
            last = min(first + BLOCK, pixels)
            x, t, p = logits[k, first:last], target[k, first:last], probability[first:last]
            part = work[: last - first]
            _sigmoid_and_bce(x, t, p, part)
            bce += _lane_sum(part, lanes)
            strange |= _strange_bits(t)
            if dice[k] != _ZERO:
                sum_p += _lane_sum(p, lanes)
                for i in range(last - first):
                    occupied = t[i] > 127
                    part[i] = p[i] if occupied else _ZERO
                    sum_t += np.int64(occupied)
                sum_pt += _lane_sum(part, lanes)
        total = sum_p + sum_t + 1.0
        share = (2.0 * sum_pt + 1.0) / total
        with_dice = dice[k] != _ZERO and sum_t > 0
        losses[k] = bce / pixels + (dice[k] * (1.0 - share) if with_dice else 0.0)
        if not wanted:
            continue
        per_pixel = np.float32(scale[k] / pixels)
        if with_dice:
            # d(1 - share) / dp = (share - 2 t) / total, and dp / dx = p (1 - p)
            outside = np.float32(scale[k] * dice[k] * share / total)
            inside = np.float32(scale[k] * dice[k] * (share - 2.0) / total)
            for i in range(pixels):
                p_i = probability[i]
                occupied = target[k, i] > 127
                slope = inside if occupied else outside
                wrong = p_i - (_ONE if occupied else _ZERO)
                gradient[k, i] = per_pixel * wrong + slope * p_i * (_ONE - p_i)
        else:
            for i in range(pixels):
                wrong = probability[i] - (_ONE if target[k, i] > 127 else _ZERO)
                gradient[k, i] = per_pixel * wrong
    return strange == 0


@kernel
def _sigmoid_and_bce(
    x: NDArray[np.float32],
    t: NDArray[np.uint8],
    sigmoid: NDArray[np.float32],
    bce: NDArray[np.float32],
) -> None:
    """``1 / (1 + exp(-x))`` and ``log(1 + exp(x)) - x t``, both by way of ``exp(-|x|)``."""
    for i in range(x.size):
        y = _LOWEST if abs(x[i]) > -_LOWEST else -abs(x[i])  # in this form NaN stays NaN
        n = np.floor(y * _LOG2_E + _HALF)
        r = y - n * _LN_2
        high = _E4 + r * (_E5 + r * (_E6 + r * _E7))
        e = _ONE + r * (_ONE + r * (_HALF + r * (_E3 + r * high)))
        e *= np.int32((np.int32(n) + np.int32(127)) << np.int32(23)).view(np.float32)  # 2^n
        inverse = _ONE / (_ONE + e)
        s = e / (_TWO + e)
        z = s * s
        high = _A7 + z * (_A9 + z * (_A11 + z * _A13))
        log = _TWO * s * (_ONE + z * (_A3 + z * (_A5 + z * high)))  # log(1 + e) = 2 artanh(s)
        sigmoid[i] = inverse if x[i] >= _ZERO else e * inverse
        bce[i] = log + max(-x[i] if t[i] > 127 else x[i], _ZERO)


@kernel
def _lane_sum(values: NDArray[np.float32], lanes: NDArray[np.float32]) -> float:
    """Sum of a block; in lanes, as one running sum cannot be vectorised."""
    lanes[:] = _ZERO
    whole = values.size // LANES * LANES
    for first in range(0, whole, LANES):
        for lane in range(LANES):
            lanes[lane] += values[first + lane]
    total = 0.0
    for lane in range(LANES):
        total += lanes[lane]
    for i in range(whole, values.size):
        total += values[i]
    return total


@kernel
def _strange_bits(masks: NDArray[np.uint8]) -> np.uint8:
    """0 if all values are 0 or 255."""
    bits = np.uint8(0)
    for i in range(masks.size):
        bits |= np.uint8(masks[i] + np.uint8(1)) & np.uint8(254)
    return bits
