"""A card for each infraction: where, by what, and the last five seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from bev_driving_env.frames import CHANNELS
from bev_driving_env.render import BEV_COLOURS, EGO

from ..drive import EpisodeResult
from . import charts, page
from .drivers import Driver, by_driver, labels
from .page import Content, Markup, element
from .replay import TIME_LIMIT
from .replay_store import Replay, Shot

SAME_S = 1e-3
"""A replay whose infraction comes earlier or later than this is another drive."""


@dataclass(frozen=True)
class Failure:
    """One moment with infractions, or the time limit of a drive.

    Attributes:
        result: The drive.
        number: Which such moment of the drive.
        names: What began there.
        time_s: Simulated time.
        route_m: Route metres driven until then.
        fault: Whose it was: "ego", "other" or "".
    """

    result: EpisodeResult
    number: int
    names: tuple[str, ...]
    time_s: float
    route_m: float
    fault: str


def failures_of(result: EpisodeResult) -> list[Failure]:
    """All moments of a drive with infractions, in order, and its time limit if that ended it."""
    moments = groupby(result.events, key=lambda event: event["time_s"])
    found = []
    for number, (time_s, group) in enumerate(moments):
        events = list(group)
        names = tuple(event["name"] for event in events)
        first = events[0]
        found.append(
            Failure(result, number, names, time_s, first["route_m"], first.get("fault", ""))
        )
    if result.truncated:
        found.append(Failure(result, len(found), (TIME_LIMIT,), result.time_s, result.driven_m, ""))
    return found


def chosen_failures(results: Sequence[EpisodeResult], most: int) -> list[Failure]:
    """Failures, of each driver in turn until there are enough, in the order of the results.

    Args:
        results: Drives.
        most: How many at most.
    """
    queues = [
        [failure for drive in drives for failure in failures_of(drive)]
        for drives in by_driver(results).values()
    ]
    longest = max((len(queue) for queue in queues), default=0)
    in_turn = [queue[k] for k in range(longest) for queue in queues if k < len(queue)]
    kept = {id(failure) for failure in in_turn[:most]}
    return [failure for queue in queues for failure in queue if id(failure) in kept]


def cards(
    results: Sequence[EpisodeResult],
    chosen: Sequence[Failure],
    replays: Mapping[str, Replay],
) -> list[Markup | str]:
    """The section: how many there are, what the colours mean, and the cards by driver.

    Args:
        results: All drives.
        chosen: Failures to show.
        replays: What was seen when their drives were driven again, by key of the job.
    """
    groups = by_driver(results)
    names = labels(groups)
    whole = sum(len(failures_of(result)) for result in results)
    told = "" if whole == len(chosen) else ", of each driver in turn"
    made: list[Markup | str] = [
        f"{len(chosen)} of {whole} infractions and time-outs are shown{told}, each with the "
        "cameras at that moment and the BEV of the last five seconds: left what the policy saw, "
        "right the truth.",
        _colours(),
        element(
            "p",
            element("button", "Play all", type="button", class_="play-all", hidden=""),
            class_="controls",
        ),
    ]
    first = True
    for driver, drives in groups.items():
        mine = [each for each in chosen if _driver(each) == driver]
        if not mine:
            continue
        words = f"{names[driver]}: {_counted(mine)} in {len(drives)} drives"
        shown = [_card(each, replays.get(each.result.job.key)) for each in mine]
        made.append(
            element(
                "details",
                element("summary", page.breakable(words)),
                element("div", shown, class_="cards"),
                open="" if first else None,
            )
        )
        first = False
    return made


def _driver(failure: Failure) -> Driver:
    return Driver(failure.result.job.bev, failure.result.job.agent)


def _counted(failures: Sequence[Failure]) -> str:
    names = [name for failure in failures for name in failure.names]
    counts = {name: names.count(name) for name in dict.fromkeys(names)}
    return ", ".join(
        f"{count} \N{MULTIPLICATION SIGN} {plain(name)}" for name, count in counts.items()
    )


def plain(name: str) -> str:
    """Name of an infraction for people.

    >>> plain("collision_static")
    'collision static'
    """
    return name.replace("_", " ")


def _colours() -> Markup:
    colours = {name: BEV_COLOURS[name] for name in CHANNELS}
    return charts.legend(
        {name: charts.hex_of(colour) for name, colour in {**colours, "ego": EGO}.items()}
    )


def _card(failure: Failure, replay: Replay | None) -> Markup:
    result, job = failure.result, failure.result.job
    what = " and ".join(plain(name) for name in failure.names)
    fault = ", the other's fault" if failure.fault == "other" else ""
    title = f"{job.town}, episode {job.index}: {what}{fault}"
    line = (
        f"at {failure.route_m:.0f} of {result.planned_m:.0f} m, after {failure.time_s:.1f} s, "
        f"seed {job.seed}"
    )
    return element(
        "article",
        element("h3", title),
        element("p", line, class_="faint"),
        _pictures(failure, replay, title),
        class_="card",
    )


def _pictures(failure: Failure, replay: Replay | None, title: str) -> Content:
    if replay is None or replay.failure:
        reason = replay.failure if replay else "it was not tried"
        return element("p", f"No pictures: the drive could not be repeated ({reason}).")
    shot = shot_of(failure, replay)
    if shot is None:
        return element(
            "p",
            "No pictures: driven again, this drive took another course. Weights, versions or the "
            "machine have changed since the run.",
        )
    slider = page.void(
        "input",
        type="range",
        min=0,
        max=shot.frames - 1,
        value=shot.frames - 1,
        aria_label=f"Moment of the last seconds. {title}",
    )
    return [
        element("p", element("span", "policy's BEV"), element("span", "truth"), class_="halves"),
        page.image(
            shot.film,
            "webp",
            f"BEV at the end of the drive, left what the policy saw, right the truth. {title}",
            class_="film",
            data_frames=shot.frames,
            decoding="async",
        ),
        element(
            "p",
            element("button", "Play", type="button", class_="play"),
            slider,
            class_="controls film-controls",
            hidden="",
        ),
        page.image(shot.cameras, "webp", f"Cameras at that moment. {title}", decoding="async"),
    ]


def shot_of(failure: Failure, replay: Replay) -> Shot | None:
    """The replay's pictures of a failure, or None if it came out differently."""
    if failure.number >= len(replay.shots):
        return None
    shot = replay.shots[failure.number]
    same = shot.names == failure.names and abs(shot.time_s - failure.time_s) < SAME_S
    return shot if same else None
