"""Drive logs as Minari datasets, read by Minari."""

import json

import numpy as np
import pytest

from agents import minari_export
from agents.minari_export import chosen_episodes, export
from bev_driving_env import DriveLog

from .finished_drives import record_log

minari = pytest.importorskip("minari")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    record_log(folder)
    return DriveLog(folder)


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return tmp_path / "datasets"


def files(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("data_format", ["arrow", "parquet"])
def test_minari_reads_what_the_log_shows_bit_for_bit(log, data_format):
    export(log, "bevtown/town02-v0", [0, 2], data_format=data_format)
    dataset = minari.load_dataset("bevtown/town02-v0")
    assert dataset.total_episodes == 2
    assert dataset.total_steps == sum(np.diff(log.starts)[[0, 2]])
    for number, episode in zip([0, 2], dataset.iterate_episodes(), strict=True):
        indices = np.arange(log.starts[number], log.starts[number + 1])
        bev, measured = episode.observations["bev"], episode.observations["measurements"]
        assert bev.dtype == np.uint8
        assert len(bev) == len(measured) == len(episode.rewards) + 1 == len(indices) + 1
        for row, index in enumerate(indices.tolist()):
            np.testing.assert_array_equal(bev[row], log.bev(index))
            np.testing.assert_array_equal(measured[row], log.measurements(index))
        np.testing.assert_array_equal(episode.actions, log.actions(indices, applied=True))
        assert episode.actions.dtype == np.float32
        np.testing.assert_array_equal(episode.infos["clean_action"][:-1], log.actions(indices))
        assert bool(episode.terminations[-1]) is (log.episodes[number].outcome == "success")
        assert bool(episode.truncations[-1]) is (log.episodes[number].outcome == "lost")


def test_the_recovered_environment_drives_the_same(log):
    export(log, "town02-v0", [1])
    dataset = minari.load_dataset("town02-v0")
    episode = dataset[0]
    env = dataset.recover_environment()
    assert env.unwrapped.settings == log.header.env_settings
    assert dataset.observation_space == env.observation_space
    (known,) = dataset.storage.get_episode_metadata([0])
    observation, _ = env.reset(seed=known["seed"], options=known["options"])
    assert observation in dataset.observation_space
    for step, action in enumerate(episode.actions):
        np.testing.assert_array_equal(observation["bev"], episode.observations["bev"][step])
        observation, reward, terminated, _, _ = env.step(action)
        assert reward == episode.rewards[step]
    assert terminated
    np.testing.assert_array_equal(observation["bev"], episode.observations["bev"][-1])


def test_the_metadata_tells_where_it_comes_from_and_which_action_is_which(log):
    export(log, "town02-v0", [0, 1], provenance={"command": "bev-agents export"})
    metadata = minari.load_dataset("town02-v0").storage.metadata
    assert "actions: what the car was given" in metadata["description"]
    assert "infos['clean_action']: what the privileged expert asked" in metadata["description"]
    assert metadata["bevtown"]["export"]["command"] == "bev-agents export"
    assert metadata["bevtown"]["log"]["provenance"]["git_commit"] == "abc"
    assert metadata["bevtown"]["log"]["seed"] == 5
    known = list(minari.load_dataset("town02-v0").storage.get_episode_metadata([0, 1]))
    assert [one["outcome"] for one in known] == ["lost", "success"]
    assert [(one["route"], one["level"]) for one in known] == [(3, 0.0), (0, 1.0)]


def test_a_cut_drive_is_several_episodes(log):
    export(log, "town02-v0", [0], max_steps=10)
    dataset = minari.load_dataset("town02-v0")
    assert [len(episode.rewards) for episode in dataset] == [10, 10, 5]
    known = dataset.storage.get_episode_metadata(range(3))
    assert [one["first_step"] for one in known] == [0, 10, 20]


def test_minari_lists_it_with_its_namespace(log):
    export(log, "bevtown/night/town02-v3", [0])
    assert list(minari.list_local_datasets()) == ["bevtown/night/town02-v3"]
    assert minari.namespace.list_local_namespaces() == ["bevtown", "bevtown/night"]


def test_a_dataset_is_replaced_only_when_asked(log, root):
    export(log, "bevtown/town02-v0", [0, 1])
    with pytest.raises(ValueError, match=r"bevtown/town02-v0 exists in .*--overwrite"):
        export(log, "bevtown/town02-v0", [2])
    assert minari.load_dataset("bevtown/town02-v0").total_episodes == 2
    export(log, "bevtown/town02-v0", [2], overwrite=True)
    assert minari.load_dataset("bevtown/town02-v0").total_episodes == 1
    assert [path.name for path in root.iterdir()] == ["bevtown"]


def test_a_failure_leaves_the_old_dataset_and_no_half_one(log, root, monkeypatch):
    export(log, "town02-v0", [0])
    before = files(root)

    def failing(env, log, number, max_steps):
        yield from real(env, log, 0, max_steps)
        raise KeyboardInterrupt

    real = minari_export.drive_again
    monkeypatch.setattr(minari_export, "drive_again", failing)
    for name in ("town02-v0", "town02-v1"):
        with pytest.raises(KeyboardInterrupt):
            export(log, name, [0, 1], overwrite=True)
    assert files(root) == before
    assert list(minari.list_local_datasets()) == ["town02-v0"]


@pytest.mark.parametrize("name", ["town02", "../town02-v0", "", "a b-v0", "/town02-v0"])
def test_what_is_no_id_is_refused(name, log, root):
    with pytest.raises(ValueError, match="must look like bevtown/town01-v0"):
        export(log, name, [0])
    assert files(root) == set()


def test_a_folder_that_is_no_dataset_is_never_replaced(log, root):
    (root / "notes-v0").mkdir(parents=True)
    (root / "notes-v0" / "mine.txt").write_text("x")
    with pytest.raises(ValueError, match="is no Minari dataset"):
        export(log, "notes-v0", [0], overwrite=True)
    assert files(root) == {"notes-v0/mine.txt"}


def test_episodes_are_chosen_by_split_level_and_number(log):
    routes = [(episode.route, episode.level) for episode in log.episodes]
    assert routes == [(3, 0.0), (0, 1.0), (3, 1.0)]
    assert chosen_episodes(log) == [0, 1, 2]
    assert chosen_episodes(log, "val") == [1]
    assert chosen_episodes(log, "train") == [0, 2]
    assert chosen_episodes(log, "all", [1.0]) == [1, 2]
    assert chosen_episodes(log, "all", [0.0, 1.0], 2) == [0, 1]
    with pytest.raises(ValueError, match=r"no level 0\.5; its levels are: 0, 1"):
        chosen_episodes(log, levels=[0.5])
    with pytest.raises(ValueError, match="split 'val'"):
        chosen_episodes(log, "val", [0.0])
    with pytest.raises(ValueError, match="at least 1 episode, got 0"):
        chosen_episodes(log, limit=0)


def test_metadata_is_plain_json(log, root):
    folder = export(log, "town02-v0", [0])
    assert folder == root / "town02-v0"
    spec = json.loads(json.loads((folder / "data" / "metadata.json").read_text())["env_spec"])
    assert spec["id"] == "BEVTown02-v0"
    assert spec["kwargs"]["traffic"] == {"vehicles": 15, "pedestrians": 50}
