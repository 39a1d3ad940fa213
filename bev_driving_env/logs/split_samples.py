"""``SplitSamples``: a split of several drive logs as one sequence of samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from .errors import LogError


class Recorded(Protocol):
    """What is asked of a log."""

    def actions(self) -> NDArray[np.float32]:
        """The expert's action (n, 2) in every sample."""

    def indices(self, split: str = "all") -> NDArray[np.int64]:
        """Samples (m,) of a split."""


Log = TypeVar("Log", bound=Recorded)


class SplitSamples(Generic[Log]):
    """Numbers the samples of a split, log after log. It keeps arrays, and no object a sample.

    Args:
        logs: The logs.
        split: ``"train"``, ``"val"`` or ``"all"``.

    Attributes:
        logs: See above.

    Raises:
        LogError: There is no sample.
    """

    def __init__(self, logs: Sequence[Log], split: str) -> None:
        self.logs = tuple(logs)
        chosen = [log.indices(split) for log in self.logs]
        self._indices = np.concatenate([np.zeros(0, np.int64), *chosen])
        self._log_of = np.repeat(np.arange(len(chosen)), [len(indices) for indices in chosen])
        if not len(self._indices):
            raise LogError(
                f"the data holds no sample of split {split!r}: collect more with bev-agents "
                "collect (route 0 is for validation, the others for training)"
            )

    def __len__(self) -> int:
        return len(self._indices)

    def log_number(self, number: int) -> int:
        """Which of the logs a sample is in."""
        return int(self._log_of[number])

    def locate(self, number: int) -> tuple[Log, int]:
        """Log and index in it of a sample."""
        return self.logs[self._log_of[number]], int(self._indices[number])

    def actions(self) -> NDArray[np.float32]:
        """The expert's action (n, 2) in every sample."""
        parts = [log.actions()[self._indices[self._log_of == k]] for k, log in enumerate(self.logs)]
        return np.concatenate(parts)
