"""Driving one episode and saying what came of it."""

from __future__ import annotations

import contextlib
import functools
import traceback
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from agents import Agent, make_agent
from bev_driving_env.env import BEVTownEnv, Observation
from bev_driving_env.info import episode_summary
from bev_driving_env.towns.registry import town_name

from .driving_score import count_infractions, driving_score, infraction_penalty
from .online import OnlineRecorder, summary
from .suites import Conditions, Job
from .video import VideoWriter


@dataclass(frozen=True)
class EpisodeResult:
    """One row of a benchmark.

    Attributes:
        job: What was driven.
        planned_m: Length of the route.
        driven_m: Route metres driven.
        success: Whether the route was completed.
        truncated: Whether the time limit ended the episode.
        infraction: Name of the first infraction, or "".
        infraction_m: Route metres at which it began, or None.
        infraction_pose: World x, y, heading there, or None.
        infractions: Number of infractions.
        steps: Control steps.
        time_s: Simulated seconds.
        episode_return: Sum of rewards.
        failure: Type and first line of what the agent or the BEV source raised, or "".
        error: Its traceback. If not empty, the episode counts as not completed, with the metres
            driven so far.
        trajectory: World x, y at reset and after each step, to the centimetre.
        events: All infractions in order, each a dict with the fields of ``InfractionEvent``.
        travelled_m: Metres driven, on the route or not.
        outside_m: How many of them were off the road or against the lane's direction.
        online: What the policy's BEV was worth on the way, see ``online.summary``; None if it
            was not looked at.
    """

    job: Job
    planned_m: float
    driven_m: float
    success: bool
    truncated: bool
    infraction: str
    infraction_m: float | None
    infraction_pose: tuple[float, float, float] | None
    infractions: int
    steps: int
    time_s: float
    episode_return: float
    failure: str
    error: str
    trajectory: tuple[tuple[float, float], ...]
    events: tuple[dict[str, Any], ...]
    travelled_m: float
    outside_m: float
    online: dict[str, Any] | None = None

    @property
    def clean(self) -> bool:
        """Whether the route was completed without an infraction."""
        return self.success and not self.infractions

    @property
    def counts(self) -> dict[str, int]:
        """How often each kind of infraction occurred by the ego's fault."""
        return count_infractions(self.events)

    @property
    def route_fraction(self) -> float:
        """Share of the route that was completed; all of it if the episode succeeded."""
        if self.success:
            return 1.0
        return min(self.driven_m / self.planned_m, 1.0) if self.planned_m > 0.0 else 0.0

    @property
    def outside_fraction(self) -> float:
        """Share of the driven metres that were off the road or against the lane's direction."""
        return min(self.outside_m / self.travelled_m, 1.0) if self.travelled_m > 0.0 else 0.0

    def penalty(self, version: str = "2.1") -> float:
        """What infractions leave of the route completion, 0 to 1."""
        return infraction_penalty(self.events, version, self.outside_fraction)

    def driving_score(self, version: str = "2.1") -> float:
        """The CARLA Leaderboard's driving score, 0 to 100."""
        return driving_score(self.route_fraction, self.events, version, self.outside_fraction)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self)

    @classmethod
    def from_dict(cls, row: dict[str, Any]) -> EpisodeResult:
        """Inverse of ``as_dict``, also after a round trip through JSON."""
        pose = row["infraction_pose"]
        known = {item.name: row[item.name] for item in fields(cls)}
        return cls(
            **{
                **known,
                "job": Job.from_dict(row["job"]),
                "infraction_pose": None if pose is None else tuple(pose),
                "trajectory": tuple((x, y) for x, y in row["trajectory"]),
                "events": tuple(row["events"]),
            }
        )


def drive(job: Job, video: Path | None = None, moments: Path | None = None) -> EpisodeResult:
    """Drive one episode; a failure of the agent or the BEV source ends it and is reported.

    Args:
        job: What to drive.
        video: MP4 file to write, or None.
        moments: ``.npz`` file for what the policy's BEV was worth at each moment, see
            ``online.OnlineMetrics``; None does not look.
    """
    env = make_env(job)
    trajectory: list[tuple[float, float]] = []
    error = failure = ""
    recorder: OnlineRecorder | None = None
    with contextlib.ExitStack() as stack:
        film = video and stack.enter_context(VideoWriter(video, env.metadata["render_fps"]))
        steps = drive_moments(env, job)
        while True:
            try:
                moment = next(steps, None)
                if moment is None:
                    break
                if moments:
                    recorder = recorder or OnlineRecorder(env, moment.agent)
                    recorder.note(moment.observation)
            except (Exception, SystemExit) as failed:  # a foreign driver's belong in its row
                error = traceback.format_exc()
                failure = f"{type(failed).__name__}: {str(failed).partition(chr(10))[0]}"
                break
            trajectory.append(env.ego_pose[:2])
            if film:
                film.add(env.draw())
    result = _result(env, job, trajectory, failure, error)
    if moments and recorder:
        metrics = recorder.metrics()
        metrics.save(moments)
        return replace(result, online=summary(metrics))
    return result


def never_driven(job: Job, failure: str) -> EpisodeResult:
    """The result of an episode whose driver brought its whole process down.

    How far it came went down with it, so it counts as 0 m.

    Args:
        job: What was to be driven.
        failure: What is known about it, in a line.
    """
    env = make_env(job, "ground_truth")
    env.reset(seed=job.seed, options=job.options)
    return _result(env, job, [], failure, failure)


def _result(
    env: BEVTownEnv,
    job: Job,
    trajectory: list[tuple[float, float]],
    failure: str,
    error: str,
) -> EpisodeResult:
    """What came of an episode, of which the environment holds the last state."""
    trajectory = trajectory or [env.ego_pose[:2]]
    summary = episode_summary(env.world, 0)
    events = summary["infractions"]
    first = events[0] if events else None
    return EpisodeResult(
        job=job,
        planned_m=summary["route_length_m"],
        driven_m=summary["route_m"],
        success=summary["success"] and not error,
        truncated=summary["truncated"],
        infraction=first["name"] if first else "",
        infraction_m=first["route_m"] if first else None,
        infraction_pose=(first["x"], first["y"], first["heading"]) if first else None,
        infractions=len(events),
        steps=summary["steps"],
        time_s=summary["time_s"],
        episode_return=summary["return"],
        failure=failure,
        error=error,
        trajectory=tuple((x, y) for x, y in np.round(trajectory, 2).tolist()),
        events=tuple(events),
        travelled_m=summary["travelled_m"],
        outside_m=summary["outside_m"],
    )


class Moment(NamedTuple):
    """The start of an episode, or what a step led to."""

    observation: Observation
    agent: Agent


def drive_moments(env: BEVTownEnv, job: Job) -> Iterator[Moment]:
    """Drive an episode to its end, pausing at the start and after each step.

    Args:
        env: The environment of the job, see :func:`make_env`.
        job: What to drive.
    """
    observation, _ = env.reset(seed=job.seed, options=job.options)
    agent: Agent = make_agent(job.agent, env)
    agent.reset(job.seed)
    ended = False
    yield Moment(observation, agent)
    while not ended:
        observation, _, terminated, truncated, _ = env.step(agent.act(observation))
        ended = terminated or truncated
        yield Moment(observation, agent)


def make_env(job: Job, bev: str | None = None) -> BEVTownEnv:
    """The environment that a job is driven in; one of a few that are kept.

    Args:
        job: The job.
        bev: BEV source instead of its own.
    """
    return _env(job.town, job.bev if bev is None else bev, job.appearance, job.conditions)


@functools.lru_cache(maxsize=10)
def _env(town: str, bev: str, appearance: str, conditions: Conditions) -> BEVTownEnv:
    env = gym.make(
        f"bev_driving_env:BEV{town_name(town)}-v0",
        bev_source=bev,
        appearance=appearance,
        **conditions.keywords,
    )
    assert isinstance(env.unwrapped, BEVTownEnv)
    return env.unwrapped
