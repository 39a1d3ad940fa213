"""What the shipped predictors go by: cameras for the road, the route map for the turn."""

from __future__ import annotations

import pytest

from agents.cli import main
from bev_driving_env.logs.drive_log import DriveLog
from perception.evaluation import evaluate
from perception.places import log_places

FRAMES = 80
LOOKING = ("cvt_kde", "ipm_unet_kde")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The first minute of all long routes of Town02, perturbed."""
    folder = tmp_path_factory.mktemp("log")
    arguments = ["--town", "Town02", "--levels", "1", "--time-limit", "60"]
    assert main(["collect", *arguments, "--workers", "1", "--out", str(folder)]) == 0
    return DriveLog(folder)


@pytest.fixture(scope="module")
def seen(log):
    """IoU by channel, and of the route in turn frames, of a source under a change."""
    known = {}

    def of(source, change="none"):
        if (source, change) not in known:
            found = evaluate(source, [log], samples=FRAMES, change=change)
            known[source, change] = {**found.iou(), "turns": found.turns().iou}
        return known[source, change]

    return of


def test_the_drive_has_turns(log):
    assert log_places(log, log.indices("all")).turn.mean() > 0.1


@pytest.mark.parametrize("source", LOOKING)
@pytest.mark.parametrize("change", ["black", "other_images"])
def test_without_its_cameras_it_is_no_better_than_one_that_has_none(seen, source, change):
    own, changed, blind = seen(source), seen(source, change), seen("blind")
    for channel in ("road", "route", "lane"):
        assert changed[channel] <= blind[channel] + 0.05, channel
        assert own[channel] > blind[channel] + 0.05, channel


@pytest.mark.parametrize("source", LOOKING)
def test_with_another_places_route_map_the_route_before_turns_is_lost_and_the_road_is_still_seen(
    seen, source
):
    own, changed, blind = seen(source), seen(source, "other_map"), seen("blind")
    assert changed["turns"] < own["turns"] - 0.25
    assert changed["road"] > own["road"] - 0.2
    assert changed["road"] > blind["road"] + 0.05
