from __future__ import annotations

import argparse

import numpy as np
import pytest

from benchmarks import play_command
from benchmarks.cli import main
from benchmarks.play_command import MOST_STEERING, command
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.settings import EnvSettings

pygame = pytest.importorskip("pygame")


@pytest.fixture
def no_display(monkeypatch):
    pygame.display.quit()
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")


@pytest.fixture
def keys(monkeypatch):
    """Function that scripts a person: which keys are held, look after look; then ``q``."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    # no waiting between frames
    monkeypatch.setitem(BEVTownEnv.metadata, "render_fps", 0)
    seen = {"resets": [], "actions": []}
    reset, step = BEVTownEnv.reset, BEVTownEnv.step

    def spy_reset(self, **arguments):
        seen["resets"].append(arguments)
        return reset(self, **arguments)

    def spy_step(self, action):
        seen["actions"].append(np.asarray(action).tolist())
        return step(self, action)

    monkeypatch.setattr(BEVTownEnv, "reset", spy_reset)
    monkeypatch.setattr(BEVTownEnv, "step", spy_step)

    def script(*held):
        looks = iter(held)
        monkeypatch.setattr(BEVTownEnv, "pressed_keys", lambda self: set(next(looks, ("q",))))
        return seen

    yield script
    pygame.display.quit()


@pytest.mark.parametrize(
    ("pressed", "gas", "turn"),
    [
        ((), -0.05, 0),
        (("up",), 0.4, 0),
        (("w", "right"), 0.4, 1),
        (("down", "left"), -1.0, -1),
        (("space",), -1.0, 0),
        (("up", "space"), -1.0, 0),
        (("s", "d"), -1.0, 1),
        (("a", "d"), -0.05, 0),
        (("left", "d"), -0.05, 0),
        (("left", "a"), -0.05, -1),
        (("n", "x", "escape"), -0.05, 0),
    ],
)
def test_held_keys_become_pedal_and_wheel(pressed, gas, turn):
    action = command(pressed, 0.0)
    assert action.dtype == np.float32
    assert action[0] == pytest.approx(gas)
    assert np.sign(action[1]) == turn


def test_the_wheel_turns_by_degrees_to_a_stop_and_returns_by_itself():
    steering, path = 0.0, []
    for _ in range(30):
        steering = float(command({"right"}, steering)[1])
        path.append(steering)
    steps = np.diff([0.0, *path])
    assert (steps >= 0.0).all()
    assert steps.max() < 0.1
    assert path[-1] == pytest.approx(MOST_STEERING)
    for _ in range(20):
        steering = float(command((), steering)[1])
    assert 0.0 <= steering < 0.01
    assert float(command({"left"}, 0.6)[1]) < 0.6


def test_a_person_drives_and_quits(keys, capsys):
    seen = keys(("up",), ("up",), ("up", "left"), ("q",))
    assert main(["play", "--town", "Town02", "--episode", "2", "--seed", "5"]) == 0
    (reset,) = seen["resets"]
    assert reset == {"seed": 5, "options": {"episode": 2}}
    gas, steering = np.transpose(seen["actions"])
    np.testing.assert_allclose(gas, 0.4, rtol=1e-6)
    assert steering[0] == steering[1] == 0.0
    assert steering[2] < 0.0
    # nothing but, in a fresh checkout, that kernels are being compiled
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if not line.startswith("BEVTown: compiling")] == []
    assert not pygame.display.get_init()


@pytest.mark.parametrize("key", ["q", "escape"])
def test_both_keys_quit_at_once(keys, key):
    seen = keys((key,))
    assert main(["play", "--town", "Town02"]) == 0
    assert seen["actions"] == []


def test_r_starts_the_episode_again_and_n_the_next_one_round_the_five(keys):
    seen = keys(("up",), ("r",), (), ("n",), (), ("q",))
    assert main(["play", "--town", "Town02", "--episode", "4"]) == 0
    assert [reset["options"]["episode"] for reset in seen["resets"]] == [4, 4, 0]
    assert {reset["seed"] for reset in seen["resets"]} == {0}
    # the wheel and the pedal start anew, and nothing is driven on a key that starts
    assert len(seen["actions"]) == 3


def test_a_key_held_too_long_goes_to_the_next_episode_only_once(keys):
    seen = keys(("n",), ("n",), ("n",), (), ("q",))
    assert main(["play", "--town", "Town02", "--episode", "0"]) == 0
    assert [reset["options"]["episode"] for reset in seen["resets"]] == [0, 1]


def test_an_ended_episode_stays_on_show_with_one_line_of_outcome(keys, capsys):
    seen = keys(*[("up", "right")] * 70, ("up",), ("q",))
    assert main(["play", "--town", "Town02"]) == 0
    (line,) = capsys.readouterr().out.strip().splitlines()
    assert "Town02/episode/0" in line
    assert "infractions: " in line
    assert "none" not in line
    assert len(seen["actions"]) < 70
    assert len(seen["resets"]) == 1


def test_the_look_is_that_of_the_papers_protocol_unless_told(keys, monkeypatch):
    looks = []
    init = BEVTownEnv.__init__

    def spy(self, *arguments, **keywords):
        looks.append((keywords["appearance"], keywords["bev_source"]))
        init(self, *arguments, **keywords)

    monkeypatch.setattr(BEVTownEnv, "__init__", spy)
    for arguments in ([], ["--appearance", "hard"], ["--bev", "ground_truth"]):
        keys(("q",))
        assert main(["play", "--town", "Town02", *arguments]) == 0
    assert [look for look, _ in looks] == ["test", "hard", "test"]
    assert {bev for _, bev in looks} == {"ground_truth"}


def test_with_others_on_the_road_the_signals_work_too(keys, monkeypatch):
    seen = {}
    settings = EnvSettings.from_keywords

    def spy(keywords):
        seen.update(keywords)
        return settings(keywords)

    monkeypatch.setattr(EnvSettings, "from_keywords", spy)
    keys()
    assert main(["play", "--traffic", "light"]) == 0
    assert (seen["traffic"], seen["traffic_lights"]) == ("light", True)


@pytest.mark.usefixtures("no_display")
def test_without_a_display_one_line_says_so(capsys):
    assert main(["play", "--town", "Town02"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("bev-bench play: ")
    assert "display" in line


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--town", "Town99"], ["Town99", "Town01"]),
        (["--bev", "xray"], ["xray", "ground_truth"]),
        (["--bev", "no_such_module:f"], ["no_such_module"]),
        (["--appearance", "dreamy"], ["dreamy", "hard"]),
        (["--episode", "9"], ["9", "0 to 4"]),
        (["--episode", "-1"], ["-1"]),
        (["--seed", "-3"], ["-3"]),
    ],
)
def test_a_mistake_is_one_line_that_names_it(arguments, names, keys, capsys):
    keys(("q",))
    assert main(["play", "--town", "Town02", *arguments]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert all(name in line for name in names), line


def test_a_predictor_that_fails_while_driving_is_one_line(keys, tmp_path, monkeypatch, capsys):
    (tmp_path / "toy_play_source.py").write_text(
        "class Fails:\n"
        "    channels = ('road',)\n"
        "    def reset(self): pass\n"
        "    def __call__(self, frame): raise OSError('no lens')\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    keys(("up",))
    assert main(["play", "--town", "Town02", "--bev", "toy_play_source:Fails"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "toy_play_source:Fails" in line
    assert "no lens" in line


def test_the_help_names_the_keys(capsys):
    with pytest.raises(SystemExit):
        main(["play", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert all(word in text for word in ("arrow keys", "space", "Q quits", "--appearance"))


def test_options_are_read_from_the_command_line(monkeypatch):
    parser = argparse.ArgumentParser()
    play_command.add_parser(parser.add_subparsers())
    options = parser.parse_args(["play", "--town", "Town02", "--seed", "3"])
    assert (options.town, options.seed, options.episode, options.bev) == (
        "Town02", 3, 0, "ground_truth",
    )  # fmt: skip
