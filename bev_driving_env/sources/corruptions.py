"""Error models of bird's-eye views: pure functions with a dose from 0, nothing, to 1.

All but :func:`latency` are called as ``model(planes, dose, rng, geometry)`` and return a new array.
``planes`` is (C, size, size) uint8, masks or probabilities times 255. ``rng`` draws what the dose
then selects from, the same numbers whatever the dose: with an equal generator, what a dose destroys
a larger dose destroys too. What happens at dose 1 is in the constants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames import BEVGeometry

Planes = NDArray[np.uint8]
Curve = NDArray[np.complexfloating[Any, Any]]
"""Points (P,) in pixels, column + 1j * row, so that a turn is a product."""
Rng = np.random.Generator
Model = Callable[[Planes, float, Rng, BEVGeometry], Planes]

BLOB_M = 1.6
"""Standard deviation of the Gaussian that smooths the noise blobs are cut from."""
BLOB_GRID_M = 0.8
"""Distance between the random numbers of that noise."""
CELL_M = 3.2
"""Side of the patches that :func:`flicker` and :func:`range_misses` lose."""
FAR_M = 30.0
"""Distance from which on :func:`range_misses` loses everything at dose 1."""
SHAPE_M = 1.6
"""How far :func:`dilation` and :func:`erosion` move an edge at dose 1."""
SHIFT_M = 4.0
"""How far :func:`shift` moves everything at dose 1."""
ROTATION_DEG = 30.0
"""How far :func:`rotation` turns everything at dose 1."""
GHOSTS = 12
"""Ghosts in each channel at dose 1."""
GHOST_SIZES_M = ((4.5, 2.0), (1.6, 1.6), (8.0, 3.5))
"""Length and width of ghosts: a car, a pedestrian as the BEV draws one, a patch of road."""
LATENCY_FRAMES = 10
"""How many frames old the BEV is at dose 1."""

ROUTE_STEP_M = 0.8
"""Distance between the points of a traced centre line."""
ROUTE_REACH_M = 4.0
"""How far to either side of the ego a route is looked for; also half the widest one."""
ROUTE_START_M = 8.0
"""How far ahead of the ego a route may begin."""
ROUTE_LONGEST_M = 100.0
ROUTE_FITS = ((20, 1), (14, 1), (10, 1), (14, 2), (10, 2), (7, 2), (5, 2), (3, 2))
"""Points and degree of the curves tried on the beginning of a route; the last one always fits."""
ROUTE_FIT_PX = 0.6
"""A curve fits when no point is farther off; masks are good to half a pixel."""
ROUTE_SEEN = 128
"""Values from here on count as route; softer pixels within ``ROUTE_HALO_PX`` go with it."""
ROUTE_HALO_PX = 2
SAMPLE_PX = 0.25
MARK = 2
"""What masks hold beyond the border of the view, or where a route was found."""


def pixel_dropout(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Lose single pixels, each with a probability of the dose."""
    return planes * (rng.random(planes.shape, dtype=np.float32) >= dose)


def blob_dropout(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Lose smooth blobs, a few metres wide, on about a dose's share of the view."""
    grid_px = BLOB_GRID_M * geometry.px_per_m
    side = int(np.ceil(geometry.size / grid_px)) + 1
    noise = rng.standard_normal((len(planes), side, side), dtype=np.float32)
    spread = np.diag([grid_px, grid_px, 1.0])[:2]
    out = planes.copy()
    for plane, rough in zip(out, noise, strict=True):
        if 0.0 < dose < 1.0 and plane.any():
            field = cv2.GaussianBlur(rough, (0, 0), BLOB_M / BLOB_GRID_M)
            # the coarse field is quicker to sort than the fine one, and has nearly its quantiles
            level = np.quantile(field, dose)
            plane[cv2.warpAffine(field, spread, plane.shape) < level] = 0
    return out if dose < 1.0 else np.zeros_like(planes)


def channel_dropout(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Lose whole channels, each with a probability of the dose."""
    return planes * (rng.random((len(planes), 1, 1)) >= dose)


def flicker(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Lose square patches, each with a probability of the dose."""
    return _without_cells(planes, np.array(dose), rng, geometry)


def range_misses(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Lose square patches, with a probability that grows in proportion to the distance."""
    centres_px = (np.arange(_cells(geometry)) + 0.5) * CELL_M * geometry.px_per_m
    pixels = np.stack(np.meshgrid(centres_px, centres_px), axis=-1)
    distance_m = np.linalg.norm(geometry.ego_from_pixel(pixels), axis=-1)
    return _without_cells(planes, dose * np.minimum(1.0, distance_m / FAR_M), rng, geometry)


def _cells(geometry: BEVGeometry) -> int:
    """Patches along one side of the view, the last one maybe cut off."""
    return int(np.ceil(geometry.size / (CELL_M * geometry.px_per_m)))


def _without_cells(
    planes: Planes, probability: NDArray[np.float64], rng: Rng, geometry: BEVGeometry
) -> Planes:
    cells = _cells(geometry)
    kept = rng.random((len(planes), cells, cells)) >= probability
    cell = (np.arange(geometry.size) / (CELL_M * geometry.px_per_m)).astype(np.intp)
    return planes * kept[:, cell][:, :, cell]


def dilation(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Move all edges outwards; nothing is random."""
    return _each(planes, lambda plane: cv2.dilate(plane, _disk(dose, geometry)))


def erosion(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Move all edges inwards, but not from the border of the view; nothing is random."""
    return _each(planes, lambda plane: cv2.erode(plane, _disk(dose, geometry)))


def _disk(dose: float, geometry: BEVGeometry) -> Planes:
    """The pixels whose centres a disk of a dose's radius covers, rounded to the nearest pixel."""
    radius_px = dose * SHAPE_M * geometry.px_per_m + 0.5
    steps = np.arange(-int(radius_px), int(radius_px) + 1)
    return (np.hypot(steps[:, None], steps) <= radius_px).astype(np.uint8)


def _each(planes: Planes, change: Callable[[Planes], object]) -> Planes:
    """Change each plane that is not black; the others would stay black and cost time."""
    out = np.zeros_like(planes)
    for plane, changed in zip(planes, out, strict=True):
        if plane.any():
            changed[:] = change(plane)
    return out


def shift(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Move everything in a random direction, by whole pixels; black comes in."""
    angle = rng.uniform(-np.pi, np.pi)
    move_px = np.array([np.cos(angle), np.sin(angle)]) * dose * SHIFT_M * geometry.px_per_m
    return _warped(planes, np.column_stack([np.eye(2), np.rint(move_px)]))


def rotation(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Turn everything about the ego, to a random side; black comes in."""
    turn_deg = dose * ROTATION_DEG * (1.0 if rng.random() < 0.5 else -1.0)
    ego = (float(geometry.ego_column), float(geometry.ego_row))
    return _warped(planes, cv2.getRotationMatrix2D(ego, turn_deg, 1.0))


def _warped(planes: Planes, matrix: NDArray[Any]) -> Planes:
    """Planes moved by a (2, 3) matrix; nearest neighbours, so that masks stay masks."""
    size = planes.shape[1:]
    return _each(planes, lambda p: cv2.warpAffine(p, matrix, size, flags=cv2.INTER_NEAREST))


def ghosts(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Draw rectangles that are not there, each at a random place and heading."""
    out = planes.copy()
    for plane, draws in zip(out, rng.random((len(planes), GHOSTS, 4)), strict=True):
        for column, row, turn, kind in draws[: round(dose * GHOSTS)].tolist():
            centre = (column * geometry.size, row * geometry.size)
            length_m, width_m = GHOST_SIZES_M[int(kind * len(GHOST_SIZES_M))]
            extent = (length_m * geometry.px_per_m, width_m * geometry.px_per_m)
            corners = cv2.boxPoints((centre, extent, 180.0 * turn))
            cv2.fillConvexPoly(plane, np.rint(corners).astype(np.int32), 255)
    return out


def latency(history: Sequence[Planes], dose: float) -> Planes:
    """Pick a past BEV, without copying it.

    Args:
        history: BEVs of an episode, the latest last. While there are too few, the oldest is picked.
        dose: 0 picks the latest, 1 the one ``LATENCY_FRAMES`` before.
    """
    return history[max(0, len(history) - 1 - round(dose * LATENCY_FRAMES))]


def straightening(planes: Planes, dose: float, rng: Rng, geometry: BEVGeometry) -> Planes:
    """Scale the curvature of the route by ``1 - dose``; meant for the route channel only.

    The centre line is traced from the ego forward. What is connected to it gives way to a band of
    the same width, length and initial direction; a plane without such a band stays as it is.
    Nothing is random.
    """
    if dose <= 0.0:
        return planes.copy()
    return _each(planes, lambda plane: _straightened(plane, dose, geometry))


def _straightened(plane: Planes, dose: float, geometry: BEVGeometry) -> Planes:
    mask = (plane >= ROUTE_SEEN).astype(np.uint8)
    points, width_px = trace_route(mask, geometry)
    column, row = (round(points[1].real), round(points[1].imag)) if len(points) else (0, 0)
    if not (len(points) and _inside(points[1], geometry) and mask[row, column]):
        return plane
    cv2.floodFill(mask, None, (column, row), MARK)
    band = mask == MARK
    halo = np.ones((2 * ROUTE_HALO_PX + 1,) * 2, np.uint8)
    out = np.where(cv2.dilate(band.astype(np.uint8), halo) > 0, 0, plane).astype(np.uint8)
    _draw_band(out, _unbent(points, dose), width_px, int(np.median(plane[band])))
    return out


def trace_route(mask: Planes, geometry: BEVGeometry) -> tuple[Curve, float]:
    """Follow a band from the ego forward in steps, after each of which its middle is found again.

    Args:
        mask: (size, size) uint8, 1 on the band and 0 off it.
        geometry: Where the ego is.

    Returns:
        Centre line, empty where there is none or it is too short to have a direction, and width in
        pixels.
    """
    step, reach = ROUTE_STEP_M * geometry.px_per_m, ROUTE_REACH_M * geometry.px_per_m
    padded = np.pad(mask, int(reach) + 2, constant_values=MARK)
    origin = (int(reach) + 2.5) * (1.0 + 1j)
    across = 1j * np.arange(-reach, reach + SAMPLE_PX / 2.0, SAMPLE_PX)
    ego = complex(geometry.ego_column, geometry.ego_row)
    points: list[complex] = []
    widths = [0.0]
    direction, ahead = -1j, ego - 1j * step
    while len(points) * ROUTE_STEP_M < ROUTE_LONGEST_M and _inside(ahead, geometry):
        found = _cross_section(padded, across, ahead + origin, direction, widths[-1])
        if found is not None:
            points.append(ahead + 1j * direction * found[0])
            widths.append(found[1])
            if len(points) > 1:
                direction = (points[-1] - points[-2]) / abs(points[-1] - points[-2])
        elif points or (ego - ahead).imag > ROUTE_START_M * geometry.px_per_m:
            break
        ahead = (points[-1] if points else ahead) + step * direction
    width = float(np.median(widths[1:] or widths))
    if len(points) < 3 or len(points) * step < 2.0 * width:
        return np.zeros(0, np.complex128), 0.0
    if not _inside(ahead, geometry):  # a band's corners leave the view after its middle
        points.append(ahead + reach / 2.0 * direction)
    return _with_start(np.array(points)), width


def _inside(pixel: complex, geometry: BEVGeometry) -> bool:
    last = geometry.size - 1
    return 0.0 <= pixel.real <= last and 0.0 <= pixel.imag <= last


def _cross_section(
    padded: Planes, across: Curve, point: complex, direction: complex, width_px: float
) -> tuple[float, float] | None:
    """Offset to the right and width of the nearest run of a mask across a direction, in pixels.

    A run that the border of the view cuts off on one side counts as ``width_px`` wide.
    """
    samples = point + direction * across
    values = padded[samples.imag.astype(np.intp), samples.real.astype(np.intp)]
    hit = values == 1
    hit[0] = hit[-1] = False
    nearest = len(across) // 2
    if not hit[nearest]:
        nearest = int(np.where(hit, np.abs(across), np.inf).argmin())
        if not hit[nearest]:
            return None
    before = nearest - int(hit[nearest::-1].argmin())
    after = nearest + int(hit[nearest:].argmin())
    left, right = across[before].imag + SAMPLE_PX / 2.0, across[after].imag - SAMPLE_PX / 2.0
    cut_left, cut_right = values[before] == MARK, values[after] == MARK
    if width_px > 0.0 and cut_left != cut_right:
        left, right = (right - width_px, right) if cut_left else (left, left + width_px)
    return float(left + right) / 2.0, float(right - left)


def _with_start(points: Curve) -> Curve:
    """Put a point a step before the first, and smooth as long a beginning as a simple curve fits.

    A band's first rows are often ragged, so that tracing begins a step after them; and all of a
    straightened route follows the direction in which it begins.
    """
    for count, degree in ROUTE_FITS:
        if count <= len(points):
            steps = np.arange(-1, count)
            fitted = np.polyval(np.polyfit(steps[1:], points[:count], degree), steps)
            if np.abs(fitted[1:] - points[:count]).max() < ROUTE_FIT_PX:
                break
    return np.append(fitted, points[count:])


def _unbent(points: Curve, dose: float) -> Curve:
    """A line with its curvature scaled by ``1 - dose``."""
    ways = np.diff(points)
    headings = np.unwrap(np.angle(ways))
    headings = headings[0] + (1.0 - dose) * (headings - headings[0])
    return np.append(points[0], points[0] + np.cumsum(np.abs(ways) * np.exp(1j * headings)))


def _draw_band(plane: Planes, points: Curve, width_px: float, value: int) -> None:
    """Draw a band with blunt ends around a line."""
    ways = np.gradient(points)
    # OpenCV also draws the outline of what it fills, half a pixel outside
    sides = 1j * ways / np.abs(ways) * max(0.5, width_px / 2.0 - 0.5)
    left, right = points - sides, points + sides
    quads = np.stack([left[:-1], right[:-1], right[1:], left[1:]], axis=1)
    corners = np.rint(16.0 * np.stack([quads.real, quads.imag], axis=-1)).astype(np.int32)
    for quad in corners:
        cv2.fillConvexPoly(plane, quad, value, shift=4)
