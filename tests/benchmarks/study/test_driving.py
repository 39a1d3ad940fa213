"""Drives of variants, and what they come to."""

import pytest

from benchmarks.study.driving import spread_routes, study_routes, summed_up, variant_jobs
from benchmarks.study.variants import PREDICTOR, Variant
from bev_driving_env.towns.registry import compiled_town, route_book


def test_routes_are_different_ones_from_short_to_long():
    chosen = spread_routes("Town01", 10)
    book, town = route_book("Town01"), compiled_town("Town01")
    lengths = [book.route("test", index, town).length_m for index in chosen]
    assert len(set(chosen)) == 10
    assert lengths == sorted(lengths)
    every = [book.route("test", index, town).length_m for index in range(50)]
    short = [length for length in every if length <= 300.0]
    assert sum(lengths) / 10 == pytest.approx(sum(short) / len(short), rel=0.05)
    assert max(lengths) <= 300.0


def test_towns_share_the_routes_evenly():
    routes = study_routes(["Town01", "Town02"], 5)
    assert [town for town, _ in routes] == ["Town01"] * 3 + ["Town02"] * 2
    assert study_routes(["Town01", "Town02"], 1)[0][0] == "Town01"


def test_more_routes_than_there_are_are_an_error():
    with pytest.raises(
        ValueError, match=r"'Town01' has \d+ 'test' routes of at most 300 m, 51 were"
    ):
        study_routes(["Town01", "Town02"], 102)


def test_variants_drive_the_same_routes_with_the_same_seeds_and_each_route_has_its_own():
    routes = study_routes(["Town01", "Town02"], 4)
    one, other = (variant_jobs(Variant(n, PREDICTOR), "bc", routes, 3) for n in ("ipm", "blind"))
    assert [job.seed for job in one] == [job.seed for job in other] == [3000, 3001, 3002, 3003]
    assert [(job.town, job.index) for job in one] == routes
    assert {job.bev for job in one} == {"ipm"}
    assert [job.appearance for job in one] == ["train", "train", "test", "test"]


def test_clean_metres_end_at_the_first_infraction(make_result):
    drives = [
        make_result(planned_m=100.0, driven_m=98.5),
        make_result(
            index=1,
            planned_m=300.0,
            driven_m=120.0,
            success=False,
            infraction="off_road",
            infraction_m=100.0,
            infractions=1,
        ),
        make_result(index=2, planned_m=100.0, driven_m=50.0, success=False, error="Traceback"),
    ]
    found = summed_up(drives)
    assert found.clean_share == pytest.approx((100.0 + 100.0 + 50.0) / 500.0)
    assert found.clean_drives == pytest.approx(1.0 / 3.0)
    assert found.shares == pytest.approx((1.0, 1.0 / 3.0, 0.5))
    assert (found.failed, found.infractions) == (1, {"off_road": 1})
    with pytest.raises(ValueError, match="without drives"):
        summed_up([])
