"""Rewinding a failed drive: when was it lost, and which channel would have saved it?

The drive is driven again with snapshots. From each, last ones first, it is driven on with one
channel replaced by the truth. The last moment at which that avoids the failure is the point of no
return: from then on no channel alone would have helped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from agents import Agent, make_agent
from bev_driving_env.env import BEVTownEnv, EnvSnapshot
from bev_driving_env.info import episode_summary
from bev_driving_env.sources.expressions import with_truth

from .drive import make_env
from .suites import Job

EVERY_STEPS = 5
"""Steps between snapshots: half a second."""
BEYOND_M = 10.0
"""A drive is saved if it comes so much farther along the route than the one that failed."""
LONGEST_STEPS = 300
"""A drive that takes longer than this to get there is not saved."""


@dataclass(frozen=True)
class Attempt:
    """What became of a drive that went on from a snapshot.

    Attributes:
        step: Step of the snapshot.
        route_m: Route metres there.
        saved_by: Channels each of which alone saves the drive from there.
    """

    step: int
    route_m: float
    saved_by: tuple[str, ...]


@dataclass(frozen=True)
class Rescue:
    """Why a drive failed.

    Attributes:
        failure: Name of the infraction, or "time limit".
        failure_step: Step at which it came.
        failure_m: Route metres there.
        attempts: From the last one before the failure backwards, until one saves the drive.
    """

    failure: str
    failure_step: int
    failure_m: float
    attempts: tuple[Attempt, ...]

    @classmethod
    def from_dict(cls, row: Mapping[str, Any] | None) -> Rescue | None:
        """Inverse of ``dataclasses.asdict``, also after a round trip through JSON."""
        if row is None:
            return None
        attempts = (
            Attempt(each["step"], each["route_m"], tuple(each["saved_by"]))
            for each in row["attempts"]
        )
        return cls(row["failure"], row["failure_step"], row["failure_m"], tuple(attempts))

    @property
    def point_of_no_return(self) -> Attempt | None:
        """The last moment at which a channel alone saves the drive; None if none was found."""
        return next((attempt for attempt in self.attempts if attempt.saved_by), None)


@dataclass(frozen=True, eq=False)
class _Kept:
    step: int
    route_m: float
    snapshot: EnvSnapshot


def rewind(
    job: Job,
    channels: Sequence[str],
    *,
    every_steps: int = EVERY_STEPS,
    most: int = 60,
) -> Rescue | None:
    """Find out when a failed drive was lost, and by which channel.

    An agent that remembers what it saw starts anew at each snapshot.

    Args:
        job: The drive; its BEV source is the one whose channels are replaced.
        channels: Which of them.
        every_steps: Steps between snapshots.
        most: Snapshots to go back at most.

    Returns:
        Why it failed; None if it does not.
    """
    env = make_env(job)
    kept, failure = _drive_with_snapshots(env, job, every_steps)
    if failure is None:
        return None
    summary = episode_summary(env.world, 0)
    failure_step, failure_m = summary["steps"], summary["route_m"]
    attempts: list[Attempt] = []
    for moment in reversed(kept[-most:]):
        saved = tuple(
            channel
            for channel in channels
            if _is_saved(job, channel, moment.snapshot, failure_m + BEYOND_M)
        )
        attempts.append(Attempt(moment.step, moment.route_m, saved))
        if saved:
            break
    return Rescue(failure, failure_step, failure_m, tuple(attempts))


def _drive_with_snapshots(
    env: BEVTownEnv, job: Job, every_steps: int
) -> tuple[list[_Kept], str | None]:
    """Snapshots on the way, and what the drive failed by; None if it did not."""
    observation, info = env.reset(seed=job.seed, options=job.options)
    agent: Agent = make_agent(job.agent, env)
    agent.reset(job.seed)
    kept = [_Kept(0, info["route_m"], env.snapshot())]
    step, ended = 0, False
    while not ended:
        observation, _, terminated, truncated, info = env.step(agent.act(observation))
        step += 1
        if info["infractions"]:
            return kept, str(info["infractions"][0])
        ended = terminated or truncated
        if not ended and step % every_steps == 0:
            kept.append(_Kept(step, info["route_m"], env.snapshot()))
    return kept, None if info["success"] else "time limit"


def _is_saved(job: Job, channel: str, snapshot: EnvSnapshot, until_m: float) -> bool:
    """Whether the drive goes on beyond a place if a channel is true from a snapshot on."""
    env = make_env(job, with_truth(job.bev, [channel]))
    env.reset(seed=job.seed, options=job.options)
    observation = env.restore(snapshot)
    agent: Agent = make_agent(job.agent, env)
    agent.reset(job.seed)
    for _ in range(LONGEST_STEPS):
        observation, _, terminated, truncated, info = env.step(agent.act(observation))
        if info["infractions"]:
            return False
        if info["success"] or info["route_m"] >= until_m:
            return True
        if terminated or truncated:
            return False
    return False
