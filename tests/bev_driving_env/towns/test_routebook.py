import itertools
import json

import numpy as np
import pytest
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork

from bev_driving_env.towns import routebook
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.registry import ROUTES_FOLDER, compiled_town, route_book
from bev_driving_env.towns.routebook import RouteBook, RouteSpec, draw_split, draw_suites, movements

MOVEMENTS = {"Town01": 12 * 6, "Town02": 8 * 6}


@pytest.fixture(params=["val", "test"])
def split(request):
    return request.param


def test_a_split_has_50_different_routes_of_80_to_400_m(town, split):
    book = route_book(town.name)
    assert book.size(split) == len(set(book.suites[split])) == 50
    for index in range(50):
        # start and end are written down to the centimetre
        assert 79.98 <= book.route(split, index, town).length_m <= 400.02


def test_a_split_covers_every_movement_of_every_junction(town, split):
    book, covered = route_book(town.name), set()
    for index in range(50):
        lanes = [town.lanes[number] for number in book.route(split, index, town).lanes]
        # a movement is an arm to come by and an arm to go by
        arms = [lane for lane in lanes if not lane.in_junction]
        covered |= {
            (before.index, after.index)
            for before, after in itertools.pairwise(arms)
            if before.index[1] != after.index[0]
        }
    assert len(covered) == MOVEMENTS[town.name]


def test_the_two_splits_share_no_route(town):
    book = route_book(town.name)
    assert not set(book.suites["val"]) & set(book.suites["test"])


def test_the_committed_split_is_the_one_its_seed_draws(town, split):
    table = json.loads((ROUTES_FOLDER / f"{town.name}.json").read_text())
    drawn = draw_split(town, split)
    rows = [{"start": [*s.start], "turns": s.turns, "end": [*s.end]} for s in drawn]
    assert rows == table[split]


@pytest.fixture
def book():
    episode = RouteSpec((140.0, 195.15), "B4L", (88.4, 251.01))
    return RouteBook("Town01", {"episode": (episode,), "val": (episode, episode)})


def test_a_book_is_read_as_it_was_written(book, tmp_path):
    path = tmp_path / "routes.json"
    book.write(path)
    assert RouteBook.read("Town01", path).suites == book.suites
    assert set(json.loads(path.read_text())) == {"episode", "val"}


def test_the_same_route_is_planned_once(book):
    town = compiled_town("Town01")
    assert book.route("episode", 0, town) is book.route("val", 1, town)
    assert book.route("val", np.int64(1), town) is book.route("val", 1, town)


def test_an_unknown_suite_is_refused_with_those_there_are(book):
    with pytest.raises(ValueError, match=r"'Town01' has no 'test' routes.*episode, val"):
        book.route("test", 0, compiled_town("Town01"))


@pytest.mark.parametrize("index", [2, -1, 1.0, True, "0", None])
def test_an_index_out_of_range_is_refused_with_the_range(book, index):
    with pytest.raises(ValueError, match=f"val {index!r} is (out of range|not an int).*0 to 1"):
        book.route("val", index, compiled_town("Town01"))


def test_a_town_without_routes_says_so():
    with pytest.raises(ValueError, match="'mine' has no 'route' routes; it has: none"):
        RouteBook("mine", {}).route("route", 0, compiled_town("Town01"))


@pytest.mark.parametrize(
    "text",
    [
        "not json",
        "[1, 2]",
        '{"val": [{"start": [0, 0], "end": [1, 1]}]}',
        '{"val": [[0, 0]]}',
        '{"val": 3}',
    ],
)
def test_a_file_of_another_shape_is_refused_by_its_name(text, tmp_path):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"broken\.json is not a route file of town 'mine'"):
        RouteBook.read("mine", path)


def test_a_missing_file_is_refused_by_its_name(tmp_path):
    with pytest.raises(ValueError, match=r"gone\.json is not a route file"):
        RouteBook.read("mine", tmp_path / "gone.json")


def passed(town, book, suite):
    """Movements that the routes of a suite go through."""
    routes = [book.route(suite, index, town) for index in range(book.size(suite))]
    steps = {step for route in routes for step in itertools.pairwise(route.lanes)}
    return steps & movements(town)


@pytest.fixture
def small_pool(monkeypatch):
    """Small towns have less to choose from."""
    monkeypatch.setattr(routebook, "POOL", 120)


@pytest.mark.usefixtures("small_pool")
def test_a_town_without_routes_has_all_suites_drawn(ladder):
    book = RouteBook("ladder", draw_suites(ladder, {}))
    sizes = {suite: book.size(suite) for suite in book.suites}
    assert sizes == {"route": 10, "episode": 5, "val": 50, "test": 50}
    for suite, (least, most) in {"route": (400, 1200), "episode": (80, 160)}.items():
        for index in range(book.size(suite)):
            assert least - 0.02 <= book.route(suite, index, ladder).length_m <= most + 0.02
    for split in ("val", "test"):
        assert passed(ladder, book, split) == movements(ladder)
    assert draw_suites(ladder, {}) == dict(book.suites)


@pytest.mark.usefixtures("small_pool")
def test_routes_that_there_are_stay_and_splits_are_drawn_anew(ladder, book):
    mine = book.suites["episode"]
    suites = draw_suites(ladder, {"episode": mine, "val": mine})
    assert suites["episode"] == mine
    assert suites["val"] != mine
    assert len(suites["val"]) == 50


def loop_with_two_ways_home(far_m, apart_m):
    """A street of 100 m that parts into two lanes, which both lead back to its start."""
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [100.0, 0.0]))
    for middle, y in (("c", apart_m), ("d", -apart_m)):
        network.add_lane("b", middle, StraightLane([100.0, 0.0], [100.0 + far_m, y]))
        network.add_lane(middle, "a", StraightLane([100.0 + far_m, y], [0.0, 0.0]))
    return compile_network("loop", network)


def test_routes_that_their_turns_do_not_tell_are_refused_by_the_way_that_is_missed():
    # both ways lead straight on
    with pytest.raises(
        ValueError, match=r"town 'loop': .*lane \('a', 'b', 0\) on .*at most one way"
    ):
        draw_split(loop_with_two_ways_home(100.0, 0.5), "val")


def test_a_ring_has_routes_that_end_before_they_come_round_again(ring):
    book = RouteBook("ring", {"val": draw_split(ring, "val")})
    for index in range(book.size("val")):
        assert len(set(book.route("val", index, ring).lanes[:-1])) <= 8  # four sides and corners
