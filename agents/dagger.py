"""DAgger: the policy drives, the expert says at every state what it would have done there.

A round is a drive log like any other (clean action: the expert's, applied: the policy's), so that
aggregating is reading one folder more. After Ross, Gordon and Bagnell (2011).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.kernels.layout import DISTANCE, SPEED
from bev_driving_env.logs.drive_log import EPISODES, VALIDATION_ROUTE
from bev_driving_env.logs.episode import STEPS, EpisodeLog
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.towns.registry import route_book

from .beta_agent import BetaAgent
from .collect import EpisodeJob, claim_folder, jobs_of, outcome_of
from .expert import Expert
from .perturbation import Perturbation
from .policy import BetaPolicy

RESCUE_M = 3.0
"""Farther than this from the route the expert takes over: beyond, a policy that drives cleanly
never needs what it would learn."""
RESCUED_M = 0.5
STUCK_S = 2.0
"""So long a policy may stand where the expert would drive."""
RESCUE_S = 3.0
ROUTES_A_ROUND = 3
LEVELS = (0.0, 0.5)
"""Perturbation levels of a round's two halves: the policy as it is, and pushed off its way."""


class Rescue:
    """Decides when the expert drives instead of a policy that is lost or stands.

    Args:
        step_s: Time between two decisions.
    """

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self._standing_s = 0.0
        self._left_s = 0.0

    def needed(self, off_route_m: float, speed_mps: float, wanted: float) -> bool:
        """Whether the expert drives the next step.

        Args:
            off_route_m: Distance from the planned lane centre.
            speed_mps: Of the car.
            wanted: The acceleration command that the expert would give.
        """
        standing = speed_mps < 0.1 and wanted > 0.05
        self._standing_s = self._standing_s + self._step_s if standing else 0.0
        if off_route_m > RESCUE_M or self._standing_s > STUCK_S:
            self._left_s = RESCUE_S
        elif off_route_m < RESCUED_M:
            self._left_s = max(0.0, self._left_s - self._step_s)
        return self._left_s > 0.0


def drive_labelled(env: BEVTownEnv, policy: BetaPolicy, job: EpisodeJob) -> EpisodeLog:
    """Let a policy drive one route, and write down what the expert would do in each state.

    Args:
        env: A town, seen by ground truth, that ends no episode on an infraction.
        policy: The policy; its deterministic actions drive.
        job: Route, perturbation level and seeds.
    """
    reset_seed, perturbation_seed = job.seeds
    observation, _ = env.reset(seed=reset_seed, options={"route": job.route})
    agent, expert, world = BetaAgent(policy, env), Expert(env), env.world
    agent.reset(reset_seed)
    recorder = job.recorder(world)
    step_s = world.config.step_s
    until_s = float(world.state.time_limit[0]) * step_s
    perturbation, rescue = Perturbation(job.level, perturbation_seed, until_s), Rescue(step_s)
    outcome = ""
    while not outcome:
        clean, state = expert.act(), world.state
        distance, speed = float(state.progress[0, DISTANCE]), float(state.ego[0, SPEED])
        if rescue.needed(distance, speed, float(clean[0])):
            applied = clean
        else:
            applied = perturbation.applied(agent.act(observation), len(recorder) * step_s)
        recorder.record(clean, applied)
        observation = env.step(applied)[0]
        outcome = outcome_of(world)
    return recorder.finish(outcome)


def round_routes(town: str, number: int, seed: int, count: int = ROUTES_A_ROUND) -> list[int]:
    """Numbers of the long routes of a round; never the one that validation looks at.

    Rounds take turns: none comes a second time before all have come once.

    Raises:
        ValueError: The town has no long routes besides.
    """
    routes = [k for k in range(route_book(town).size("route")) if k != VALIDATION_ROUTE]
    if not routes:
        raise ValueError(f"town {town!r} has no long routes to drive for DAgger besides route 0")
    order: NDArray[np.int64] = np.random.default_rng([seed, 1]).permutation(routes)
    first = number * count
    return [int(order[k % len(order)]) for k in range(first, first + min(count, len(order)))]


def drive_round(folder: Path, base: LogHeader, policy: BetaPolicy, number: int, seed: int) -> int:
    """Drive one round and keep it as a drive log; episodes already there are not driven again.

    Args:
        folder: The round's own.
        base: Header of the log that is aggregated with: the town, traffic and all settings.
        policy: Drives.
        number: Of the round, from 0.
        seed: Of the training.

    Returns:
        Labelled states in the round.

    Raises:
        LogError: The folder holds something else.
    """
    drawn = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    header = LogHeader(
        town=base.town,
        settings={**base.settings, "terminate_on": []},
        control_hz=base.control_hz,
        physics_hz=base.physics_hz,
        seed=drawn,
        levels=LEVELS,
        provenance={**base.provenance, "dagger_round": number},
    )
    folder.mkdir(parents=True, exist_ok=True)
    claim_folder(folder, header)
    env = BEVTownEnv(base.town, **header.settings)
    states = 0
    for job in jobs_of(header, round_routes(base.town, number, seed)):
        if (folder / EPISODES / f"{job.name}{STEPS}").exists():
            continue
        log = drive_labelled(env, policy, job)
        log.write(folder / EPISODES)
        states += len(log)
    return states
