"""Training a camera-to-BEV network on samples that are rendered as it goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bev_driving_env.frames import CHANNELS
from bev_driving_env.training.optimisation import Measured, Optimisation
from bev_driving_env.training.processes import of_all_processes

from .iou_counts import IoUCounts, best_thresholds, iou_counts
from .loading import BatchPlan, SampleBatch, Waited, batches_in_order, sample_loader
from .losses import bev_loss
from .metrics import Floats
from .models.presets import ModelSpec
from .precision import resolved_precision
from .samples import BEVSamples
from .starting import Start
from .training_config import TrainingConfig

VALIDATION_BATCH = 8


@dataclass(frozen=True)
class Validation:
    """What a validation showed.

    Attributes:
        channel_losses: Unweighted loss of each channel (C,).
        counts: Pixels at all thresholds.
    """

    channel_losses: Floats
    counts: IoUCounts

    @property
    def loss(self) -> float:
        """Mean of the channels' losses."""
        return float(self.channel_losses.mean())

    def iou(self, thresholds: Floats | None = None) -> Floats:
        """Dataset-level IoU of each channel (C,), at 0.5 if no thresholds (C,) are given."""
        if thresholds is None:
            thresholds = np.full(len(self.channel_losses), 0.5)
        return self.counts.at(thresholds).dataset_iou()[:, 0]

    def thresholds(self) -> Floats:
        """Those with the highest IoU (C,)."""
        return best_thresholds(self.counts)


@dataclass
class Pace:
    """How fast training is.

    Attributes:
        frames: Frames learned from, over all processes.
        seconds: Time spent learning from them or waiting for them.
        waited_s: The part of it in which there was nothing to learn from.
    """

    frames: int = 0
    seconds: float = 0.0
    waited_s: float = 0.0

    def add(self, frames: int, seconds: float, waited_s: float) -> None:
        """Note a step."""
        self.frames += frames
        self.seconds += seconds
        self.waited_s += waited_s

    @property
    def frames_per_s(self) -> float:
        """Frames a second."""
        return self.frames / self.seconds if self.seconds else 0.0

    @property
    def waiting_share(self) -> float:
        """Part of the time in which the network had nothing to do."""
        return self.waited_s / self.seconds if self.seconds else 0.0


class Trainer(Optimisation):
    """Trains a new network.

    Args:
        config: How to train.
        spec: The network.
        device: Where.
        start: Weights to start from; None starts at random.

    Attributes:
        config: See above, with the precision that it came to.
        spec: See above.
        pace: Of this session, without its first step, which starts workers and compiles.
        batches_before: Batches of the sequence that are left out, because the predictor that it
            starts from has learned from as many frames.

    Raises:
        TrainingError: The batch cannot be shared evenly by the processes.
    """

    def __init__(
        self,
        config: TrainingConfig,
        spec: ModelSpec,
        device: torch.device | None = None,
        start: Start | None = None,
    ) -> None:
        device = device or torch.device("cpu")
        self.config = replace(config, precision=resolved_precision(config.precision, device))
        self.spec = spec
        self.pace = Pace()
        torch.manual_seed(config.seed)
        network = {"architecture": spec.architecture, **spec.config.as_json()}
        identity = {
            **asdict(self.config),
            **network,
            "start": None if start is None else start.digest,
        }
        module = spec.build()
        if start is not None:
            module.load_state_dict(start.weights, strict=False)
        # with the same seed the same frames would come again
        self.batches_before = 0 if start is None else -(-start.frames // config.batch_size)
        super().__init__(module.to(device), self.config, identity, device)
        self._planes = [CHANNELS.index(name) for name in spec.config.channels]

    def train(
        self,
        samples: BEVSamples,
        weights: NDArray[np.float32] | None = None,
        *,
        until: int | None = None,
        workers: int = 0,
    ) -> Iterator[Measured]:
        """Train; yields after each step, when all is in order to be kept.

        Args:
            samples: What to learn from.
            weights: What each sample counts in each channel (n, C); None: all the same.
            until: Step to stop before; the last one if None.
            workers: Processes that render; 0 renders in this one.
        """
        config = self.config
        end, before = config.steps if until is None else until, self.batches_before
        span = (before + self.step, before + end)
        plan = BatchPlan(
            len(samples), config.batch_size, config.seed, span, config.flips, self.rank, self.ranks
        )
        on_gpu = self.device.type == "cuda"
        waited = Waited(sample_loader(samples, plan, workers=workers, pinned=on_gpu))
        factors = None if weights is None else torch.from_numpy(weights)
        first, began, waited_s = True, time.monotonic(), 0.0
        with closing(iter(waited)) as batches:
            for batch in batches:
                chosen = None if factors is None else factors[batch.numbers].to(self.device)
                measured = self.learn(batch.to(self.device), chosen)
                seconds = time.monotonic() - began
                self.trained_s += seconds
                if not first:
                    self.pace.add(config.batch_size, seconds, waited.waited_s - waited_s)
                first, waited_s = False, waited.waited_s
                yield measured
                began = time.monotonic()

    def learn(self, batch: SampleBatch, weights: Tensor | None = None) -> Measured:
        """One step on a batch, whose samples count (B, C) or (B,)."""
        # what layers draw at random must not depend on whether training was stopped before
        drawn = np.random.SeedSequence([self.config.seed, self.step, self.rank])
        torch.manual_seed(int(drawn.generate_state(1)[0]))

        def loss_of(model: nn.Module) -> Tensor:
            with self.autocast():
                logits = model(batch.inputs)
            return bev_loss(logits, self._target(batch), weights, kinds=self.config.loss)[0]

        return self.update(loss_of)

    def validate(self, samples: BEVSamples) -> Validation:
        """Look at samples spread evenly over a split; the weights are kept if they are the best."""
        count = min(len(samples), self.config.validation_samples)
        numbers = np.linspace(0, len(samples) - 1, count).astype(np.int64)
        batches = batches_in_order(numbers, VALIDATION_BATCH)[self.rank :: self.ranks]
        self.module.eval()
        mine = [self._looked_at(batch) for batch in sample_loader(samples, batches, workers=0)]
        parts = [part for of_one in of_all_processes(mine) for part in of_one]
        counts = IoUCounts.merged([counted for _, counted in parts])
        losses = np.sum([summed for summed, _ in parts], axis=0) / len(counts)
        validation = Validation(losses, counts)
        self.judge(validation.loss)
        return validation

    def _looked_at(self, batch: SampleBatch) -> tuple[Floats, IoUCounts]:
        """Sum of each channel's loss over a batch (C,), and its pixels."""
        on_device = batch.to(self.device)
        target = self._target(on_device)
        with torch.inference_mode():
            with self.autocast():
                logits = self.module(on_device.inputs)
            _, losses = bev_loss(logits, target, kinds=self.config.loss)
            bytes_ = torch.sigmoid(logits.float()).mul_(255.0).round_().to(torch.uint8)
        counts = iou_counts(bytes_.numpy(force=True), target.numpy(force=True))
        return losses.double().numpy(force=True) * len(counts), counts

    def _target(self, batch: SampleBatch) -> Tensor:
        """The true BEVs (B, C, S, S) of the channels that are learned."""
        target = batch.target()
        return target if self._planes == list(range(len(CHANNELS))) else target[:, self._planes]

    def best_model(self) -> nn.Module:
        """A network with the best weights; the last ones while nothing was validated."""
        model = self.spec.build()
        model.load_state_dict(self.best_weights())
        return model.eval()
