from __future__ import annotations

import io
import json

import numpy as np
from PIL import Image

from benchmarks.maps import MARGIN_M, PALETTE, draw_trajectories, png_bytes
from bev_driving_env.towns.registry import compiled_town


def at(image: np.ndarray, world: tuple[float, float], width_px: int) -> list[int]:
    """Colour of the map at a world point."""
    x0, y0, x1, _ = compiled_town("Town01").bounds
    scale = width_px / (x1 - x0 + 2 * MARGIN_M)
    column, row = ((np.array(world) - (x0 - MARGIN_M, y0 - MARGIN_M)) * scale).astype(int)
    return image[row, column].tolist()


def test_each_source_gets_a_colour_along_its_trajectory(make_result):
    results = [
        make_result(bev="ground_truth", trajectory=[[200.0, -2.0], [300.0, -2.0]]),
        make_result(bev="other", trajectory=[[200.0, 330.6], [300.0, 330.6]]),
        make_result(bev="other", town="Town02", trajectory=[[0.0, 0.0], [500.0, 500.0]]),
    ]
    image = draw_trajectories("Town01", results, width_px=1000)
    assert at(image, (250.0, -2.0), 1000) == list(PALETTE[0])
    assert at(image, (250.0, 330.6), 1000) == list(PALETTE[1])


def test_completed_ends_are_white_and_infractions_carry_an_arrow(make_result, make_event):
    done = make_result(trajectory=[[200.0, -2.0], [300.0, -2.0]])
    stopped = make_result(
        index=1,
        trajectory=[[200.0, 330.6], [300.0, 330.6]],
        success=False,
        infractions=1,
        infraction="off_road",
        infraction_pose=(300.0, 330.6, 0.0),
        events=[make_event("off_road", x=300.0, y=330.6, heading=0.0)],
    )
    image = draw_trajectories("Town01", [done, stopped], width_px=1000)
    assert at(image, (300.0, -2.0), 1000) == [255, 255, 255]
    assert at(image, (300.0, 330.6), 1000) == list(PALETTE[0])
    # the arrow's head reaches beyond the end of the line
    assert at(image, (301.5, 330.6), 1000) == list(PALETTE[0])


def test_infractions_that_ended_nothing_carry_arrows_too(make_result, make_event):
    places = (220.0, 260.0)
    result = make_result(
        trajectory=[[200.0, -2.0], [300.0, -2.0]],
        infractions=2,
        events=[make_event("red_light", x=x, y=-2.0) for x in places],
    )
    image = draw_trajectories("Town01", [result], width_px=1000)
    # where the line alone is too thin to reach
    for x in places:
        assert at(image, (x - 1.5, -0.7), 1000) == list(PALETTE[0])
    assert at(image, (240.0, -0.7), 1000) != list(PALETTE[0])
    assert at(image, (300.0, -2.0), 1000) == [255, 255, 255]


def test_the_png_carries_its_provenance_and_is_small(make_result):
    image = draw_trajectories("Town02", [make_result(town="Town02")])
    content = png_bytes(image, {"command": "bev-bench run"})
    assert len(content) < 100_000
    with Image.open(io.BytesIO(content)) as decoded:
        assert decoded.size == (image.shape[1], image.shape[0])
        assert json.loads(decoded.text["provenance"]) == {"command": "bev-bench run"}
