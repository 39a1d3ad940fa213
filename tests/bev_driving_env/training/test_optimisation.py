"""Optimising a toy: a line through points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
import torch
from torch import nn

from bev_driving_env.training.optimisation import Optimisation, TrainingError
from bev_driving_env.training.schedule import one_cycle


@dataclass(frozen=True)
class ToySettings:
    steps: int = 40
    batch_size: int = 8
    learning_rate: float = 0.05
    weight_decay: float = 0.0
    clip_norm: float = 100.0
    precision: str = "fp32"
    patience: int = 2


def line(**changes):
    torch.manual_seed(0)
    settings = ToySettings(**changes)
    identity = {"learning_rate": settings.learning_rate}
    return Optimisation(nn.Linear(1, 1), settings, identity, torch.device("cpu"))


def loss_of(module):
    x = torch.linspace(-1.0, 1.0, 8)[:, None]
    return (module(x) - (2.0 * x + 1.0)).square().mean()


def run(optimisation, until):
    return [optimisation.update(loss_of).loss for _ in range(optimisation.step, until)]


def test_the_steps_are_those_of_adamw_with_the_rates_of_one_cycle():
    optimisation = line(weight_decay=0.1)
    torch.manual_seed(0)
    plain = nn.Linear(1, 1)
    optimizer = torch.optim.AdamW(plain.parameters(), lr=1.0, weight_decay=0.1)
    for step in range(40):
        optimizer.param_groups[0]["lr"] = one_cycle(step, 40, 0.05)
        loss = loss_of(plain)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        assert optimisation.update(loss_of).loss == loss.item()
    assert torch.equal(optimisation.module.weight, plain.weight)


def test_resuming_gives_the_same_bits_as_never_stopping(tmp_path):
    whole = run(line(), 40)
    stopped = line()
    run(stopped, 7)
    stopped.judge(3.0)
    stopped.rows.append({"step": 7.0})
    stopped.save(tmp_path / "checkpoint.pt")
    resumed = line()
    resumed.restore(tmp_path / "checkpoint.pt")
    assert (resumed.step, resumed.best_value, resumed.rows) == (7, 3.0, [{"step": 7.0}])
    assert run(resumed, 40) == whole[7:]


def test_the_best_weights_are_kept_until_they_are_forgotten():
    optimisation = line()
    last = optimisation.best_weights()["weight"]
    assert last is optimisation.module.state_dict()["weight"] or torch.equal(
        last, optimisation.module.weight
    )
    optimisation.judge(1.0)
    kept = optimisation.module.weight.detach().clone()
    run(optimisation, 5)
    optimisation.judge(2.0)
    assert not optimisation.exhausted
    optimisation.judge(float("nan"))
    assert optimisation.exhausted
    assert torch.equal(optimisation.best_weights()["weight"], kept)
    optimisation.forget_best()
    assert not optimisation.exhausted
    optimisation.judge(2.0)
    assert torch.equal(optimisation.best_weights()["weight"], optimisation.module.weight)


def test_gradients_are_shortened_to_the_longest_allowed():
    optimisation = line(clip_norm=1e-3)
    measured = optimisation.update(loss_of)
    left = math.sqrt(sum(float(p.grad.square().sum()) for p in optimisation.module.parameters()))
    assert measured.gradient_norm > 1e-3
    assert left == pytest.approx(1e-3, rel=1e-3)


def test_a_gradient_that_is_not_finite_stops_it_before_it_spoils_the_weights():
    optimisation = line()
    before = optimisation.module.weight.detach().clone()
    with pytest.raises(TrainingError, match=r"gradient of step 0 is not finite .* --learning-rate"):
        optimisation.update(lambda module: loss_of(module) * torch.inf)
    assert torch.equal(optimisation.module.weight, before)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a checkpoint", "damaged or no checkpoint"),
        ({"format": "other"}, "not a checkpoint of BEVTown"),
        ({"format": "bevtown-training", "version": 99}, "version 99"),
    ],
)
def test_a_foreign_or_newer_checkpoint_is_one_clear_error(tmp_path, content, message):
    path = tmp_path / "checkpoint.pt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    with pytest.raises(TrainingError, match=message):
        line().restore(path)


def test_a_checkpoint_that_was_cut_off_is_one_clear_error(tmp_path):
    path = tmp_path / "checkpoint.pt"
    line().save(path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(TrainingError, match="damaged"):
        line().restore(path)


def test_a_checkpoint_of_another_training_is_refused_by_what_differs(tmp_path):
    line().save(tmp_path / "checkpoint.pt")
    with pytest.raises(TrainingError, match=r"learning_rate 0\.05, this one has 0\.1"):
        line(learning_rate=0.1).restore(tmp_path / "checkpoint.pt")


def test_half_precision_is_what_the_network_computes_in():
    optimisation = line(precision="bf16")
    with optimisation.autocast():
        assert optimisation.module(torch.zeros(2, 1)).dtype == torch.bfloat16
    with line().autocast():
        assert optimisation.module(torch.zeros(2, 1)).dtype == torch.float32
