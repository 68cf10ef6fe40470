"""Videos, frame by frame, by OpenCV."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write


def read_frames(
    path: str | Path, wanted: set[int] | None = None
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield number and frame (height, width, 3) uint8, blue first, in their order.

    Args:
        path: of the video.
        wanted: numbers of frames; the others are passed over.

    Raises:
        SimrigError: no file, no video, or one without frames.
    """
    if not Path(path).is_file():
        raise SimrigError(f"there is no video '{path}'")
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        number = -1
        while video.grab():
            number += 1
            if wanted is not None and number not in wanted:
                continue
            there, frame = video.retrieve()
            if there:
                yield number, frame
        if number < 0:
            raise SimrigError(f"'{path}' is no video that can be read, or has no frames")
    finally:
        video.release()


class VideoFile:
    """A video that is being written (see ``written_video``)."""

    def __init__(self, writer: cv2.VideoWriter):
        self._writer = writer

    def add(self, frame: np.ndarray) -> None:
        """Append a frame (height, width, 3) uint8, blue first."""
        self._writer.write(frame)


@contextmanager
def written_video(
    path: str | Path, fps: float, size: tuple[int, int], quality: int = 95
) -> Iterator[VideoFile]:
    """Write an M-JPEG video (.avi): under a temporary name until it is whole.

    Args:
        path: of the video.
        fps: frames per second; the file says 1 at least.
        size: width and height.
        quality: of JPEG, 1 to 100.

    Raises:
        SimrigError: a folder that is not there, or no room.
    """
    with atomic_write(path) as temporary:
        code = cv2.VideoWriter.fourcc(*"MJPG")
        writer = cv2.VideoWriter(str(temporary), cv2.CAP_OPENCV_MJPEG, code, max(fps, 1.0), size)
        if not writer.isOpened():
            raise SimrigError(f"cannot write the video '{path}': its name must end in .avi")
        writer.set(cv2.VIDEOWRITER_PROP_QUALITY, quality)
        try:
            yield VideoFile(writer)
        finally:
            writer.release()
