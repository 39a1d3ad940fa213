"""Episodes as MP4 files."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray


class VideoWriter:
    """Writes RGB frames of one size to an MP4 file, which appears when all is written.

    If an exception ends the ``with`` block, what was written so far is kept too.

    Args:
        path: The file.
        fps: Frames per second.

    Raises:
        OSError: OpenCV cannot write it.
    """

    def __init__(self, path: Path, fps: float) -> None:
        self._path = path
        self._fps = fps
        self._partial = path.with_name(f".{path.stem}.partial.mp4")
        self._writer: cv2.VideoWriter | None = None

    def __enter__(self) -> VideoWriter:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        return self

    def add(self, frame: NDArray[np.uint8]) -> None:
        """Append a frame (H, W, 3)."""
        if self._writer is None:
            height, width = frame.shape[:2]
            code = cv2.VideoWriter.fourcc(*"mp4v")
            writer = cv2.VideoWriter(str(self._partial), code, self._fps, (width, height))
            if not writer.isOpened():
                raise OSError(f"OpenCV cannot write the video {self._path}")
            self._writer = writer
        self._writer.write(np.ascontiguousarray(frame[..., ::-1]))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._writer is not None:
            self._writer.release()
            self._partial.replace(self._path)
