"""The true BEV: what an agent drives on when nothing stands between it and the world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frames import CHANNELS
from .protocol import BEVSourceError, PrivilegedSource, SensorFrame


class GroundTruth(PrivilegedSource):
    """``bev_source="ground_truth"``: a privileged source that returns the true BEV as it is.

    Attributes:
        channels: All channels.
        needs_frame: False: no camera image is rendered for it.
        needs_truth: True.
    """

    channels: tuple[str, ...] = CHANNELS
    needs_frame: bool = False
    needs_truth: bool = True

    def reset(self) -> None:
        """Nothing is remembered."""

    def perceive(
        self, frame: SensorFrame | None, truth: NDArray[np.uint8] | None
    ) -> NDArray[np.uint8]:
        """Return the true BEV.

        Args:
            frame: Ignored.
            truth: (6, size, size) uint8.

        Returns:
            ``truth`` itself, not a copy.

        Raises:
            BEVSourceError: There is no truth.
        """
        if truth is None:
            raise BEVSourceError("ground_truth", "needs the true BEV, got None")
        return truth

    def __call__(self, frame: SensorFrame) -> NDArray[np.uint8]:
        """Refuse: what a car senses does not contain the truth.

        Raises:
            BEVSourceError: Always.
        """
        raise BEVSourceError(
            "ground_truth",
            "is not a function of sensor frames: it needs an environment, as in "
            'gymnasium.make("BEVTown01-v0", bev_source="ground_truth")',
        )
