from __future__ import annotations

from benchmarks.report.failures import cards, chosen_failures, failures_of, shot_of
from benchmarks.report.page import text_of
from benchmarks.report.replay_store import Replay, Shot


def failed(make_result, make_event, bev="ipm", index=0, times=(5.0,), **changes):
    events = [make_event("off_road", time_s=time_s) for time_s in times]
    return make_result(
        bev=bev,
        index=index,
        success=False,
        infraction="off_road",
        infractions=len(events),
        events=events,
        **changes,
    )


def test_each_moment_with_infractions_is_a_failure_and_what_began_together_is_one(
    make_result, make_event
):
    result = make_result(
        events=[
            make_event("off_road", time_s=5.0, route_m=20.0),
            make_event("collision_static", time_s=5.0, route_m=20.0),
            make_event("red_light", time_s=9.0, route_m=31.0),
        ]
    )
    found = failures_of(result)
    assert [each.names for each in found] == [("off_road", "collision_static"), ("red_light",)]
    assert [(each.number, each.route_m) for each in found] == [(0, 20.0), (1, 31.0)]


def test_a_clean_drive_has_no_failure_and_one_that_ran_out_of_time_has(make_result):
    assert failures_of(make_result()) == []
    (late,) = failures_of(make_result(success=False, truncated=True, time_s=90.0))
    assert (late.names, late.time_s) == (("time_limit",), 90.0)


def test_failures_are_chosen_of_each_driver_in_turn_and_shown_in_the_order_of_the_run(
    make_result, make_event
):
    results = [failed(make_result, make_event, "a", k) for k in range(4)]
    results += [failed(make_result, make_event, "b", k) for k in range(2)]
    results.append(make_result(bev="c"))

    def shown(most: int) -> list[tuple[str, int]]:
        chosen = chosen_failures(results, most)
        return [(each.result.job.bev, each.result.job.index) for each in chosen]

    assert shown(0) == []
    assert shown(3) == [("a", 0), ("a", 1), ("b", 0)]
    assert shown(5) == [("a", 0), ("a", 1), ("a", 2), ("b", 0), ("b", 1)]
    assert len(shown(100)) == 6


SHOT = Shot(5.0, ("off_road",), 26, b"film", b"cameras")


def test_a_replay_that_came_out_differently_is_not_shown(make_result, make_event):
    (failure,) = failures_of(failed(make_result, make_event))
    assert shot_of(failure, Replay((SHOT,))) is SHOT
    assert shot_of(failure, Replay(())) is None
    assert shot_of(failure, Replay((Shot(5.1, ("off_road",), 26, b"", b""),))) is None
    assert shot_of(failure, Replay((Shot(5.0, ("blocked",), 26, b"", b""),))) is None


def test_cards_say_how_many_of_how_many_and_why_pictures_are_missing(make_result, make_event):
    results = [failed(make_result, make_event, index=k) for k in range(3)]
    chosen = chosen_failures(results, 2)
    keys = [each.result.job.key for each in chosen]
    replays = {keys[0]: Replay((SHOT,)), keys[1]: Replay((), "ValueError: <gone>")}
    made = text_of(cards(results, chosen, replays))
    assert "2 of 3 infractions and time-outs are shown" in made
    assert "ipm: 2 \N{MULTIPLICATION SIGN} off road in 3 drives" in made
    assert made.count('class="film"') == 1
    assert "ValueError: &lt;gone&gt;" in made
    other = text_of(cards(results, chosen[:1], {keys[0]: Replay(())}))
    assert "took another course" in other


def test_the_others_fault_is_named(make_result, make_event):
    event = make_event("collision_vehicle", fault="other")
    results = [make_result(success=False, events=[event])]
    made = text_of(cards(results, chosen_failures(results, 9), {}))
    assert "collision vehicle, the other's fault" in made.replace("&#x27;", "'")
