"""What commands that train share."""

import argparse

import pytest
import torch

from bev_driving_env.training.command import add_run_options, run_in_processes


def test_options_have_defaults_that_work_everywhere():
    parser = argparse.ArgumentParser()
    add_run_options(parser)
    given = parser.parse_args([])
    assert (given.threads, given.device, given.checkpoint_minutes) == (None, "cpu", 2.0)
    assert (given.tensorboard, given.overwrite) == (False, False)


def test_one_process_is_the_one_that_shows():
    told, before = [], torch.get_num_threads()
    try:
        run_in_processes(1, told.append)
        assert torch.get_num_threads() == 1
    finally:
        torch.set_num_threads(before)
    assert told == [True]


def test_threads_must_be_positive():
    with pytest.raises(ValueError, match="--threads"):
        run_in_processes(0, lambda chief: pytest.fail("it should not have started"))
