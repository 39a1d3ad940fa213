"""Training a predictor: what it minimises, resuming, validation."""

import math
import socket

import numpy as np
import pytest
import torch
import torch.distributed as dist
import torch.multiprocessing as multiprocessing
from torch.nn import functional

from bev_driving_env.frames import CHANNELS
from bev_driving_env.logs.order import open_logs
from bev_driving_env.training.optimisation import TrainingError
from perception.loading import BatchPlan, batches_in_order, sample_loader
from perception.metrics import channel_iou
from perception.samples import BEVSamples
from perception.starting import Start
from perception.training import Pace, Trainer
from perception.training_config import TrainingConfig

NEEDS = frozenset({"ground", "route_map"})
pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def logs(log_folder):
    return open_logs([log_folder])


@pytest.fixture(scope="module")
def samples(logs):
    return BEVSamples(logs, "train", NEEDS, looks="random")


@pytest.fixture(scope="module")
def validation(logs):
    return BEVSamples(logs, "val", NEEDS)


def config(**changes):
    fields = {"steps": 24, "batch_size": 2, "precision": "fp32", "validation_samples": 9}
    return TrainingConfig(**{**fields, **changes})


def trained(trainer, samples, until=None, weights=None):
    return [measured.loss for measured in trainer.train(samples, weights, until=until)]


def assert_same_weights(first, second):
    others = second.module.state_dict()
    for name, value in first.module.state_dict().items():
        assert torch.equal(value, others[name]), name


def with_dropout(trainer):
    """Half of the logits vanish in training: what a step draws at random matters."""
    trainer.module.register_forward_hook(
        lambda module, _, logits: functional.dropout(logits, 0.5, module.training)
    )
    return trainer


def test_resuming_gives_the_same_bits_as_never_stopping(samples, tiny_spec, tmp_path):
    whole = with_dropout(Trainer(config(), tiny_spec))
    losses = trained(whole, samples)
    stopped = with_dropout(Trainer(config(), tiny_spec))
    trained(stopped, samples, until=4)
    stopped.save(tmp_path / "checkpoint.pt")
    torch.manual_seed(99)
    resumed = with_dropout(Trainer(config(), tiny_spec))
    resumed.restore(tmp_path / "checkpoint.pt")
    assert resumed.step == 4
    assert trained(resumed, samples) == losses[4:]
    assert len(losses) == 24
    assert_same_weights(whole, resumed)


def test_training_learns(samples, validation, tiny_spec):
    trainer = Trainer(config(steps=60, learning_rate=2e-2), tiny_spec)
    before = trainer.validate(validation)
    trained(trainer, samples)
    after = trainer.validate(validation)
    assert after.loss < 0.92 * before.loss
    assert after.channel_losses[0] < 0.9 * before.channel_losses[0]
    assert trainer.best_value == after.loss


def test_the_loss_is_bce_weighted_by_sample_and_channel(samples, tiny_spec):
    spec = tiny_spec.with_channels(("lane", "vehicles"))
    trainer, seed = Trainer(config(), spec), Trainer(config(), spec).module.state_dict()
    weights = np.random.default_rng(0).uniform(0.0, 3.0, (len(samples), 2)).astype(np.float32)
    plan = BatchPlan(len(samples), 2, 0, (0, 1))
    (batch,) = sample_loader(samples, plan, workers=0)
    model = spec.build()
    model.load_state_dict(seed)
    with torch.no_grad():
        logits = model(batch.inputs)
    target = batch.target()[:, [2, 3]].float() / 255.0
    planes = functional.binary_cross_entropy_with_logits(logits, target, reduction="none")
    wanted = (planes.mean(dim=(2, 3)) * torch.from_numpy(weights)[batch.numbers]).mean()
    (loss,) = trained(trainer, samples, until=1, weights=weights)
    assert loss == pytest.approx(wanted.item(), rel=1e-5)


def test_samples_of_weight_zero_teach_nothing(samples, tiny_spec):
    trainer = Trainer(config(weight_decay=0.0), tiny_spec)
    before = {name: value.clone() for name, value in trainer.module.state_dict().items()}
    trained(trainer, samples, until=2, weights=np.zeros((len(samples), 6), np.float32))
    for name, value in trainer.module.state_dict().items():
        assert torch.equal(value, before[name])


def test_validation_measures_evenly_spread_samples_as_the_drive_looked(validation, tiny_spec):
    trainer = Trainer(config(), tiny_spec)
    torch.nn.init.normal_(trainer.module.unet.head.weight, std=0.3)
    found = trainer.validate(validation)
    numbers = np.linspace(0, len(validation) - 1, 9).astype(int)
    (batch,) = sample_loader(validation, batches_in_order(numbers, 9), workers=0)
    with torch.no_grad():
        logits = trainer.module(batch.inputs)
    probability, target = torch.sigmoid(logits).numpy(), batch.target()
    planes = functional.binary_cross_entropy_with_logits(
        logits, target.float() / 255.0, reduction="none"
    )
    np.testing.assert_allclose(found.channel_losses, planes.mean(dim=(0, 2, 3)), rtol=1e-5)
    assert found.loss == pytest.approx(planes.mean().item(), rel=1e-5)
    # batches of another size may round to another 255th
    wanted = channel_iou(probability, target.numpy())
    np.testing.assert_allclose(found.iou(), wanted, atol=5e-3)
    best = found.thresholds()
    np.testing.assert_allclose(
        found.iou(best), channel_iou(probability, target.numpy(), list(best)), atol=5e-3
    )
    assert (np.nan_to_num(found.iou(best)) >= np.nan_to_num(found.iou())).all()
    again = trainer.validate(validation)
    np.testing.assert_array_equal(again.channel_losses, found.channel_losses)


def test_the_best_weights_are_kept_when_validation_gets_worse(validation, tiny_spec):
    trainer = Trainer(config(patience=1), tiny_spec)
    best = trainer.validate(validation)
    with torch.no_grad():
        trainer.module.unet.head.bias += 5.0
    assert trainer.validate(validation).loss > best.loss
    assert trainer.exhausted
    assert not torch.equal(trainer.best_model().unet.head.bias, trainer.module.unet.head.bias)


@pytest.mark.parametrize("changes", [{"precision": "bf16"}, {"loss": "bce_dice"}, {"flips": False}])
def test_every_way_of_training_trains(changes, samples, tiny_spec):
    plain, other = Trainer(config(), tiny_spec), Trainer(config(**changes), tiny_spec)
    losses = trained(other, samples, until=3)
    assert all(map(math.isfinite, losses))
    assert losses != trained(plain, samples, until=3)


def test_a_checkpoint_of_another_training_is_refused_by_what_differs(tiny_spec, tmp_path):
    Trainer(config(), tiny_spec).save(tmp_path / "checkpoint.pt")
    path = tmp_path / "checkpoint.pt"
    for other, message in (
        (Trainer(config(temper=0.5), tiny_spec), r"temper 1\.0, this one has 0\.5"),
        (Trainer(config(), tiny_spec.with_channels(("road",))), "channels"),
    ):
        with pytest.raises(TrainingError, match=message):
            other.restore(path)


def test_a_training_that_goes_on_from_a_predictor_sees_the_frames_after_its(samples, tiny_spec):
    seen = []

    class Noting(Trainer):
        def learn(self, batch, weights=None):
            seen[-1].append(batch.numbers.tolist())
            return super().learn(batch, weights)

    weights = tiny_spec.build().state_dict()
    for frames in (0, 4):
        seen.append([])
        start = Start(weights, "toy", {"samples": frames})
        trained(Noting(config(), tiny_spec, start=start), samples, until=4)
    assert seen[1][:2] == seen[0][2:]
    assert seen[1][2:] != seen[0][:2]


def test_the_pace_is_frames_and_waiting_in_the_time_of_training(samples, tiny_spec):
    pace = Pace()
    assert (pace.frames_per_s, pace.waiting_share) == (0.0, 0.0)
    pace.add(8, 2.0, 0.5)
    pace.add(8, 2.0, 0.5)
    assert (pace.frames_per_s, pace.waiting_share) == (4.0, 0.25)
    trainer = Trainer(config(), tiny_spec)
    trained(trainer, samples, until=4)
    assert trainer.pace.frames == 3 * 2  # the first step starts everything
    assert 0.0 < trainer.pace.waiting_share < 1.0
    assert trainer.trained_s >= trainer.pace.seconds


@pytest.mark.slow
def test_two_processes_train_the_same_network_as_one(
    logs, samples, validation, tiny_spec, tmp_path
):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    arguments = (port, tiny_spec, str(logs[0].folder), str(tmp_path / "two.pt"))
    multiprocessing.spawn(_train_in_rank, arguments, nprocs=2)
    alone = Trainer(config(), tiny_spec)
    trained(alone, samples, until=3)
    together = torch.load(tmp_path / "two.pt", weights_only=True)
    for name, value in alone.module.state_dict().items():
        assert torch.allclose(value, together["weights"][name], atol=2e-4), name
    found = alone.validate(validation)
    assert together["value"] == pytest.approx(found.loss, rel=1e-2)
    assert together["iou"] == pytest.approx(found.iou()[:3].tolist(), abs=0.02)


def _train_in_rank(rank, port, spec, folder, path):
    torch.set_num_threads(1)
    dist.init_process_group("gloo", init_method=f"tcp://localhost:{port}", rank=rank, world_size=2)
    logs = open_logs([folder])
    trainer = Trainer(config(), spec)
    trained(trainer, BEVSamples(logs, "train", NEEDS, looks="random"), until=3)
    # nine samples are two batches: one for each process
    found = trainer.validate(BEVSamples(logs, "val", NEEDS))
    assert len(found.counts) == 9
    if rank == 0:
        weights = trainer.module.state_dict()
        kept = {"weights": weights, "value": found.loss, "iou": found.iou()[:3].tolist()}
        torch.save(kept, path)
    dist.destroy_process_group()


def test_targets_are_the_channels_that_are_learned(samples, tiny_spec):
    (batch,) = sample_loader(samples, BatchPlan(len(samples), 2, 0, (0, 1)), workers=0)
    names = ("lights", "road")
    trainer = Trainer(config(), tiny_spec.with_channels(names))
    planes = [CHANNELS.index(name) for name in names]
    assert torch.equal(trainer._target(batch), batch.target()[:, planes])
