import itertools
import json

import numpy as np
import pytest

from bev_driving_env.towns.registry import ROUTES_FOLDER, compiled_town, route_book
from bev_driving_env.towns.routebook import RouteBook, RouteSpec, draw_split

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
