"""``bev-bench play``: a person drives, by what the policy would see."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from bev_driving_env.command_line import UsageError
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.towns.registry import town_name
from bev_driving_env.world.traffic import PRESETS

from .suites import LOOKS

STEERING_STEP = 0.06
"""How far a held arrow key turns the wheel in a tenth of a second."""
RETURN_SHARE = 0.35
MOST_STEERING = 0.6
KEYS = "arrow keys or WASD drive, space brakes, R starts again, N goes to the next episode, Q quits"


@dataclass(frozen=True)
class PlayOptions:
    """Options of ``bev-bench play``.

    Attributes:
        town: Name of the town.
        bev: BEV source.
        appearance: Look of the world.
        episode: Evaluation episode to start with.
        seed: Seed of looks and traffic.
        traffic: Other road users; with any, the signals work too.
    """

    town: str
    bev: str
    appearance: str
    episode: int
    seed: int
    traffic: str = "none"

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise UsageError(f"--seed must be at least 0, got {self.seed}")


def add_parser(verbs: Any) -> None:
    """Add the verb ``play``."""
    parser = verbs.add_parser(
        "play",
        help="drive with the keyboard (needs a display)",
        description=f"Drive an episode yourself and see what the policy would see. Keys: {KEYS}.",
    )
    parser.add_argument("--town", default="Town01", metavar="TOWN", help="default: Town01")
    parser.add_argument(
        "--bev", default="ground_truth", metavar="SOURCE", help="default: ground_truth"
    )
    parser.add_argument(
        "--appearance", metavar="LOOK", help="train, test or hard; default: the paper's protocol"
    )
    parser.add_argument("--episode", type=int, default=0, help="0 to 4; default: 0")
    parser.add_argument("--seed", type=int, default=0, help="of looks and traffic; default: 0")
    parser.add_argument(
        "--traffic",
        choices=PRESETS,
        default="none",
        help="with others on the road the signals work too; default: none",
    )
    parser.set_defaults(command=run, interrupted="")


def command(pressed: Collection[str], steering: float) -> NDArray[np.float32]:
    """The action that held keys ask for.

    Args:
        pressed: Names of the keys held down, as pygame names them.
        steering: The last steering command; the wheel turns and returns by degrees.

    Returns:
        Acceleration and steering (2,).
    """
    held = set(pressed)
    gas, brake = bool(held & {"up", "w"}), bool(held & {"down", "s", "space"})
    turn = bool(held & {"right", "d"}) - bool(held & {"left", "a"})
    if turn:
        steering = steering + turn * STEERING_STEP
    else:
        steering *= 1.0 - RETURN_SHARE
    steering = min(max(steering, -MOST_STEERING), MOST_STEERING)
    acceleration = -1.0 if brake else 0.4 if gas else -0.05
    return np.array([acceleration, steering], np.float32)


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb; returns 0.

    Raises:
        UsageError: The arguments are not valid, or there is no display.
    """
    try:
        name = town_name(namespace.town)
    except ValueError as error:
        raise UsageError(str(error)) from error
    look = namespace.appearance or LOOKS.get(namespace.town, "train")
    options = PlayOptions(
        namespace.town,
        namespace.bev,
        look,
        namespace.episode,
        namespace.seed,
        namespace.traffic,
    )
    try:
        env = gym.make(
            f"bev_driving_env:BEV{name}-v0",
            bev_source=options.bev,
            appearance=options.appearance,
            traffic=options.traffic,
            traffic_lights=options.traffic != "none",
            render_mode="human",
        ).unwrapped
        assert isinstance(env, BEVTownEnv)
        drive(env, options)
    except (ValueError, RuntimeError) as error:
        raise UsageError(str(error)) from error
    return 0


def drive(env: BEVTownEnv, options: PlayOptions) -> None:
    """Let a person drive episode after episode until they quit."""
    episode, outcome = options.episode, ""
    while True:
        env.reset(seed=options.seed, options={"episode": episode})
        outcome = _episode(env, held=bool(outcome))
        if outcome == "quit":
            break
        if outcome == "next":
            episode = (episode + 1) % 5
    env.close()


def _episode(env: BEVTownEnv, *, held: bool) -> str:
    """Drive one episode; returns ``"quit"``, ``"again"`` or ``"next"``.

    Args:
        env: The environment, just reset.
        held: Whether a key started the episode: it counts again only after it was let go.
    """
    steering, ended = 0.0, False
    while True:
        pressed = env.pressed_keys()
        if pressed & {"q", "escape"}:
            return "quit"
        starting = pressed & {"r", "n"}
        if starting and not held:
            return "again" if "r" in starting else "next"
        held = held and bool(starting)
        if ended:
            env.render()
            continue
        action = command(pressed, steering)
        steering = float(action[1])
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            ended = True
            summary = info["episode_summary"]
            names = ", ".join(event["name"] for event in summary["infractions"]) or "none"
            print(
                f"{summary['episode_id']}: {summary['route_m']:.1f} of "
                f"{summary['route_length_m']:.1f} m, infractions: {names} (R again, N next, Q quit)"
            )
