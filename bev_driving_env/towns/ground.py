"""What the ground is made of, as a pyramid of ever coarser textures: lane paint, cracks, kerbs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.fill import fill_band
from ..kernels.layout import RasterGrid
from ..kernels.pyramid import reduce_codes
from .raster import MARGIN_M, Raster, blank_raster

if TYPE_CHECKING:
    from .compiled import CompiledTown, Lane

MATERIALS = ("grass", "asphalt", "patch", "crack", "sidewalk", "kerb", "white", "yellow")
GRASS, ASPHALT, PATCH, CRACK, SIDEWALK, KERB, WHITE, YELLOW = range(8)
SHARES = 8
"""A texel mixes two materials in eighths."""
LEVELS = 6
FINEST_PX_PER_M = 20.0
MOST_PX = 1 << 27
MARK_M = 0.125
STOP_LINE_M = 0.4
KERB_M = 0.15
DASH_M, GAP_M = 3.0, 4.5
WEAR = 0.15
"""Share of the paint that traffic has worn off."""
SEED = 20


def _code_book() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Mixtures by code: (codes, 2) materials and (codes,) eighths of the second one.

    The first eight codes are the pure materials.
    """
    pairs = [(a, a) for a in range(len(MATERIALS))]
    eighths = [0] * len(MATERIALS)
    for a in range(len(MATERIALS)):
        for b in range(a + 1, len(MATERIALS)):
            for share in range(1, SHARES):
                pairs.append((a, b))
                eighths.append(share)
    return np.array(pairs, np.uint8), np.array(eighths, np.uint8)


CODE_MATERIALS, CODE_EIGHTHS = _code_book()


def _code_index() -> NDArray[np.uint8]:
    """Codes (8, 8, 9) of a pair of materials and the eighths of the second."""
    index = np.zeros((len(MATERIALS), len(MATERIALS), SHARES + 1), np.uint8)
    for code, ((a, b), share) in enumerate(zip(CODE_MATERIALS, CODE_EIGHTHS, strict=True)):
        index[a, b, share] = code
        index[b, a, SHARES - share] = code
    for a in range(len(MATERIALS)):
        index[a, :, 0] = a
        index[:, a, SHARES] = a
    return index


CODE_INDEX = _code_index()


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground texture of a town.

    Attributes:
        grid: Position and resolution of level 0; each further level is half as fine.
        texels: All levels one after the other, codes of ``CODE_MATERIALS`` and ``CODE_EIGHTHS``.
        offsets: (L,) where each level starts in ``texels``.
        shapes: (L, 2) rows and columns of each level.
    """

    grid: RasterGrid
    texels: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    shapes: NDArray[np.int64]


def build_ground(town: CompiledTown) -> Ground:
    """Paint a town's ground and reduce it level by level; the same in every process."""
    fine = paint_materials(town)
    levels = [reduce_codes(fine.pixels, CODE_MATERIALS, CODE_EIGHTHS, CODE_INDEX)]
    for _ in range(LEVELS - 1):
        levels.append(reduce_codes(levels[-1], CODE_MATERIALS, CODE_EIGHTHS, CODE_INDEX))
    sizes = np.array([level.size for level in levels])
    grid = fine.grid
    return Ground(
        grid=RasterGrid(grid.x0_m, grid.y0_m, grid.px_per_m / 2.0),
        texels=np.concatenate([level.ravel() for level in levels]),
        offsets=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        shapes=np.array([level.shape for level in levels], np.int64),
    )


def paint_materials(town: CompiledTown) -> Raster:
    """Raster (rows, columns) of pure materials at 20 px/m, coarser for very large towns."""
    x0, y0, x1, y1 = town.bounds
    area = (x1 - x0 + 2.0 * MARGIN_M) * (y1 - y0 + 2.0 * MARGIN_M)
    px_per_m = min(FINEST_PX_PER_M, math.sqrt(MOST_PX / area))
    raster = blank_raster(town.bounds, px_per_m)
    section, rng = town.cross_section, np.random.default_rng(SEED)
    bands = ((section.sidewalk_m, SIDEWALK), (KERB_M if section.sidewalk_m else 0.0, KERB))
    for extra_m, material in bands:
        for lane in town.lanes if extra_m > 0.0 else ():
            half = lane.half_width + section.shoulder_m + extra_m
            _band(raster, lane.points, -half, half, material)
    for lane in town.lanes:
        half = lane.half_width + section.shoulder_m
        _band(raster, lane.points, -half, half, ASPHALT)
    for lane in town.lanes:
        _age(raster, lane, rng)
    for lane in town.lanes:
        if not lane.in_junction:
            _mark(raster, lane)
    for x1, y1, x2, y2 in town.stop_lines:
        _stop_line(raster, x1, y1, x2, y2)
    _wear(raster, rng)
    return raster


def _band(
    raster: Raster,
    points: NDArray[np.float64],
    left_m: NDArray[np.float64],
    right_m: NDArray[np.float64],
    material: int,
) -> None:
    grid = raster.grid
    fill_band(
        raster.pixels, grid.x0_m, grid.y0_m, grid.px_per_m, points, left_m, right_m, 0, material
    )


def _along(lane: Lane, start_m: float, end_m: float, offset_m: float) -> NDArray[np.float64]:
    """Points (M, 4) of the curve beside a lane, between two stations of the lane."""
    count = max(2, math.ceil((end_m - start_m) / 0.5) + 1)
    stations = np.linspace(start_m, end_m, count)
    points = np.column_stack(
        [np.interp(stations, lane.stations, column) for column in lane.points.T]
    )
    points[:, 0] -= points[:, 3] * offset_m
    points[:, 1] += points[:, 2] * offset_m
    return points


def _mark(raster: Raster, lane: Lane) -> None:
    """Paint a lane's boundaries: dashes, symmetric about the middle so that both sides agree."""
    for side, present, striped in zip((-1.0, 1.0), lane.lines, lane.striped, strict=True):
        if not present:
            continue
        offset = side * float(lane.half_width.mean())
        pieces = [(0.0, lane.length_m)]
        if striped:
            line = _along(lane, 0.0, lane.length_m, offset)[:, :2]
            length_m = float(np.hypot(*np.diff(line, axis=0).T).sum())
            count = math.floor((length_m - DASH_M) / 2.0 / (DASH_M + GAP_M))
            centers = (DASH_M + GAP_M) * np.arange(-count, count + 1) + length_m / 2.0
            scale = lane.length_m / length_m
            pieces = [((c - DASH_M / 2.0) * scale, (c + DASH_M / 2.0) * scale) for c in centers]
        for start_m, end_m in pieces:
            points = _along(lane, max(0.0, start_m), min(lane.length_m, end_m), offset)
            half = np.full(len(points), MARK_M / 2.0)
            _band(raster, points, -half, half, YELLOW if striped else WHITE)


def _stop_line(raster: Raster, x1: float, y1: float, x2: float, y2: float) -> None:
    length = math.hypot(x2 - x1, y2 - y1)
    dx, dy = (x2 - x1) / length, (y2 - y1) / length
    points = np.array([[x1, y1, dx, dy], [x2, y2, dx, dy]])
    half = np.full(2, STOP_LINE_M / 2.0)
    _band(raster, points, -half, half, WHITE)


def _age(raster: Raster, lane: Lane, rng: np.random.Generator) -> None:
    """Lay patches and cracks over a lane."""
    half = float(lane.half_width.mean())
    for _ in range(rng.poisson(lane.length_m / 18.0)):
        start = rng.uniform(0.0, lane.length_m)
        points = _along(lane, start, start + rng.uniform(1.0, 7.0), rng.uniform(-1.0, 1.0))
        width = np.full(len(points), rng.uniform(0.3, 1.3))
        _band(raster, points, -width, width, PATCH)
    for _ in range(rng.poisson(lane.length_m / 9.0)):
        steps = int(rng.integers(4, 14))
        stations = rng.uniform(0.0, lane.length_m) + np.cumsum(rng.normal(0.25, 0.35, steps))
        offsets = rng.uniform(-half, half) + np.cumsum(rng.normal(0.0, 0.3, steps))
        points = np.column_stack(
            [np.interp(stations, lane.stations, column) for column in lane.points.T]
        )
        offsets = np.clip(offsets, -half, half)
        x = points[:, 0] - points[:, 3] * offsets
        y = points[:, 1] + points[:, 2] * offsets
        grid = raster.grid
        pixels = (np.column_stack([x - grid.x0_m, y - grid.y0_m]) * grid.px_per_m).astype(np.int32)
        cv2.polylines(raster.pixels, [pixels], False, CRACK, 1)


def _wear(raster: Raster, rng: np.random.Generator) -> None:
    """Rub off some of the paint, in spots of a few decimetres."""
    painted = np.flatnonzero(raster.pixels >= WHITE)
    rows, columns = np.divmod(painted, raster.pixels.shape[1])
    noise = np.pad(rng.random((64, 64)), 8, "wrap")
    spots = np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.2))[8:-8, 8:-8]
    limit = np.quantile(spots, WEAR)
    fine = rng.random(len(painted)) < 0.1
    cell = max(1, round(raster.grid.px_per_m * 0.15))
    worn = (spots[rows // cell % 64, columns // cell % 64] < limit) | fine
    raster.pixels.ravel()[painted[worn]] = ASPHALT
