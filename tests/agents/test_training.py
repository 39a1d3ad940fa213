"""Training: what it minimises, the learning rate, resuming, checkpoints."""

import math
import socket

import numpy as np
import pytest
import torch
import torch.distributed as dist
import torch.multiprocessing as multiprocessing

from agents.batches import SampleSet
from agents.network import NetworkConfig, smallest_bev_size
from agents.training import Trainer
from agents.training_config import TrainingConfig
from bev_driving_env.training.optimisation import TrainingError

SIZE = smallest_bev_size() + 1  # geometries have an even side
NETWORK = NetworkConfig(bev_size=SIZE)


class ToyLog:
    """A bright or dark BEV decides the steering, the speed decides the acceleration."""

    def __init__(self, count=60):
        rng = np.random.default_rng(5)
        self._side = rng.integers(0, 2, count)
        self._speed = rng.uniform(0.0, 6.0, count).astype(np.float32)
        self._noise = rng.integers(0, 60, (count, 6, SIZE, SIZE), dtype=np.uint8)

    def bev(self, index):
        return self._noise[index] + np.uint8(180 * self._side[index])

    def measurements(self, index):
        return np.array([self._speed[index], 0.0, 0.0], np.float32)

    def actions(self):
        return np.stack([self._speed / 12.0, self._side - 0.5], axis=1).astype(np.float32)

    def indices(self, split="all"):
        count = len(self._speed)
        return np.arange(count)[: 12 if split == "val" else count]


pytestmark = pytest.mark.usefixtures("one_thread")


def config(**changes):
    return TrainingConfig(**{"steps": 24, "batch_size": 6, "learning_rate": 1e-3, **changes})


def trained(trainer, until):
    return [measured.loss for measured in trainer.train(SampleSet([ToyLog()]), until)]


def weights_of(trainer):
    return {name: value.clone() for name, value in trainer.actor.state_dict().items()}


def same(first, second):
    return all(torch.equal(first[name], second[name]) for name in first)


def test_training_learns_what_decides_the_action():
    trainer = Trainer(config(steps=200), NETWORK)
    validation = SampleSet([ToyLog()], "val")
    before = trainer.validate(validation)
    trained(trainer, 200)
    # steering: two places; a density that covers them alike would stay near 0
    assert trainer.validate(validation) < min(before, 0.0) - 0.5
    batch = validation.batch(np.arange(12))
    with torch.no_grad():
        alpha, beta = trainer.actor(batch.bev, batch.measurements)
    steering = ((alpha - beta) / (alpha + beta))[:, 1]
    assert (torch.sign(steering) == torch.sign(batch.actions[:, 1])).all()


def test_resuming_gives_the_same_bits_as_never_stopping(tmp_path):
    whole = Trainer(config(), NETWORK)
    losses = trained(whole, 24)
    stopped = Trainer(config(), NETWORK)
    trained(stopped, 4)
    stopped.save(tmp_path / "checkpoint.pt")
    torch.manual_seed(99)
    resumed = Trainer(config(), NETWORK)
    resumed.restore(tmp_path / "checkpoint.pt")
    assert resumed.step == 4
    assert trained(resumed, 24) == losses[4:]
    assert same(weights_of(whole), weights_of(resumed))


def test_another_seed_gives_other_weights():
    first, second = Trainer(config(), NETWORK), Trainer(config(seed=1), NETWORK)
    assert not same(weights_of(first), weights_of(second))


def test_samples_of_weight_zero_teach_nothing():
    def only_left(actions):
        return (actions[:, 1] < 0.0).astype(np.float64)

    trainer = Trainer(config(steps=60), NETWORK)
    for _ in trainer.train(SampleSet([ToyLog()], weigh=only_left), 60):
        pass
    batch = SampleSet([ToyLog()]).batch(np.arange(60))
    with torch.no_grad():
        alpha, beta = trainer.actor(batch.bev, batch.measurements)
    assert ((alpha - beta)[:, 1] < 0.0).all()


def test_the_best_weights_are_kept_when_validation_gets_worse():
    trainer = Trainer(config(patience=2), NETWORK)
    validation = SampleSet([ToyLog()], "val")
    trained(trainer, 20)
    best = trainer.validate(validation)
    kept = weights_of(trainer)
    for spoils in (1, 2):
        assert not trainer.exhausted
        with torch.no_grad():
            trainer.actor.head.alpha.bias += 10.0 * spoils
        assert trainer.validate(validation) > best
    assert trainer.exhausted
    assert trainer.best_value == best
    assert same(kept, dict(trainer.best_policy().actor().state_dict()))


def test_half_precision_trains_too():
    trainer = Trainer(config(precision="bf16"), NETWORK)
    assert all(math.isfinite(nll) for nll in trained(trainer, 3))


def test_a_checkpoint_of_another_training_is_refused_by_what_differs(tmp_path):
    Trainer(config(), NETWORK).save(tmp_path / "checkpoint.pt")
    other = Trainer(config(learning_rate=5e-4), NETWORK)
    with pytest.raises(TrainingError, match=r"learning_rate 0\.001, this one has 0\.0005"):
        other.restore(tmp_path / "checkpoint.pt")


@pytest.mark.parametrize(
    ("changes", "name"),
    [({"steps": 0}, "steps"), ({"learning_rate": 0.0}, "learning_rate"), ({"seed": -1}, "seed")],
)
def test_settings_out_of_range_are_named(changes, name):
    with pytest.raises(ValueError, match=name):
        config(**changes)


def test_two_processes_train_the_same_policy_as_one(tmp_path):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    multiprocessing.spawn(_train_in_rank, (port, str(tmp_path / "two.pt")), nprocs=2)
    alone = Trainer(config(), NETWORK)
    trained(alone, 4)
    together = torch.load(tmp_path / "two.pt", weights_only=True)
    for name, value in alone.actor.state_dict().items():
        assert torch.allclose(value, together[name], atol=2e-4), name


def _train_in_rank(rank, port, path):
    torch.set_num_threads(1)
    dist.init_process_group("gloo", init_method=f"tcp://localhost:{port}", rank=rank, world_size=2)
    trainer = Trainer(config(), NETWORK)
    trained(trainer, 4)
    trainer.validate(SampleSet([ToyLog()], "val"))
    if rank == 0:
        torch.save(trainer.actor.state_dict(), path)
    dist.destroy_process_group()
