"""A log as a PyTorch dataset."""

import pickle

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from bev_driving_env import DriveLog
from bev_driving_env.logs.dataset import LogDataset

from .short_drives import STEPS


def test_an_item_is_the_policys_input_and_the_clean_action(recorded):
    log = DriveLog(recorded[0])
    data = LogDataset(log, "train", channels=("lane", "vehicles"))
    assert len(data) == STEPS
    item = data[4]
    assert sorted(item) == ["action", "bev", "measurements"]
    index = STEPS + 4
    np.testing.assert_array_equal(item["bev"].numpy(), log.bev(index)[[2, 3]])
    np.testing.assert_array_equal(item["measurements"].numpy(), log.measurements(index))
    np.testing.assert_array_equal(item["action"].numpy(), log.actions()[index])
    assert [item[name].dtype for name in sorted(item)] == [
        torch.float32,
        torch.uint8,
        torch.float32,
    ]


def test_cameras_and_route_map_come_if_asked_for(recorded):
    data = LogDataset(recorded[0], "val", channels=(), images=True, route_map=True)
    item = data[2]
    assert "bev" not in item
    np.testing.assert_array_equal(item["images"].numpy(), data.log.images(2))
    np.testing.assert_array_equal(item["route_map"].numpy(), data.log.route_map(2))


def test_a_window_is_consecutive_steps(recorded):
    data = LogDataset(recorded[0], "train", window=3, stride=10)
    assert len(data) == 7
    item = data[1]
    assert item["bev"].shape == (3, 3, 192, 192)
    first = STEPS + 10
    for k in range(3):
        np.testing.assert_array_equal(item["bev"][k].numpy(), data.log.bev(first + k)[:3])
    np.testing.assert_array_equal(item["action"].numpy(), data.log.actions()[first : first + 3])


def test_workers_of_a_loader_render_the_same(recorded):
    data = LogDataset(recorded[0], "val")
    assert len(pickle.dumps(data)) < 100_000
    loader = DataLoader(
        data, batch_size=35, num_workers=1, multiprocessing_context="spawn", shuffle=False
    )
    batches = list(loader)
    assert [len(batch["bev"]) for batch in batches] == [35, 35]
    np.testing.assert_array_equal(batches[1]["bev"][0].numpy(), data.log.bev(35)[:3])


def test_an_unknown_channel_is_named(recorded):
    with pytest.raises(ValueError, match="unknown channel 'lanes'; channels are: road"):
        LogDataset(recorded[0], channels=("lanes",))
