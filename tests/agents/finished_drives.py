"""A log of three drives that take a second: two arrive, one is given up."""

import numpy as np

from agents import Expert
from agents.collect import drive_episode, jobs_of, log_settings
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.logs.drive_log import EPISODES
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.settings import EnvSettings

TOWN = "Town02"
LEVELS = (0.0, 1.0)
GIVEN_UP_AFTER = 25


def record_log(folder):
    """Route 0 and 3 perturbed with success after 2 % of the way; then route 3 without."""
    soon = {"success_fraction": 0.02, "success_distance_m": 5000.0}
    settings = EnvSettings(traffic="light", traffic_lights=True, rules=soon)
    kept = log_settings(TOWN, settings)
    header = LogHeader(TOWN, kept, 10, 20, 5, LEVELS, {"git_commit": "abc", "machine": "a PC"})
    header.write(folder)
    env = BEVTownEnv(TOWN, **kept)
    plain, *perturbed = (job for job in jobs_of(header, [3, 0]) if (job.route, job.level) != (0, 0))
    for job in perturbed:
        drive_episode(env, job).write(folder / EPISODES)
    give_up(env, plain).write(folder / EPISODES)


def give_up(env, job):
    """Drive some steps, swerving, and leave it at that."""
    env.reset(seed=job.seeds[0], options={"route": job.route})
    expert = Expert(env)
    recorder = job.recorder(env.world)
    for step in range(GIVEN_UP_AFTER):
        clean = expert.act()
        applied = np.clip(clean + np.float32(0.3 * (step % 5 == 0)), -1.0, 1.0).astype(np.float32)
        recorder.record(clean, applied)
        env.step(applied)
    return recorder.finish("lost")
