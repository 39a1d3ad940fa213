"""Short drives through dense traffic that are taken down and looked at while they happen."""

import numpy as np

from agents import Expert
from agents.collect import EpisodeJob, log_settings
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.logs.drive_log import EPISODES
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.settings import EnvSettings

TOWN = "Town02"
STEPS, LOOKED_AT = 70, (0, 1, 33, 69)


def drive(env, job, steps, look):
    """Drive some steps of an episode, swerving, and take it down; look at some of them."""
    env.reset(seed=job.seeds[0], options={"route": job.route})
    expert = Expert(env)
    recorder = job.recorder(env.world)
    for step in range(steps):
        clean = expert.act()
        applied = np.clip(clean + np.float32(0.2 * (step % 5 == 0)), -1.0, 1.0).astype(np.float32)
        recorder.record(clean, applied)
        if step in LOOKED_AT:
            look(step, env, clean, applied)
        env.step(applied)
    return recorder.finish("success")


def record_log(folder, appearance, steps=STEPS):
    """A log of two episodes; returns what was seen live by sample."""
    settings = EnvSettings(traffic="dense", traffic_lights=True, appearance=appearance)
    env = BEVTownEnv(TOWN, **log_settings(TOWN, settings))
    header = LogHeader(TOWN, log_settings(TOWN, settings), 10, 20, 0, (0.5,))
    header.write(folder)
    seen, first = {}, 0
    for route in (0, 3):

        def look(step, env, clean, applied, first=first):
            seen[first + step] = {
                "bev": env.ground_truth_bev(),
                "frame": env.sensor_frame(),
                "state": env.world.state.copy(),
                "clean": clean,
                "applied": applied,
            }

        log = drive(env, EpisodeJob(0, route, 0.5, header.collection_seed(0)), steps, look)
        log.write(folder / EPISODES)
        first += len(log)
    return seen
