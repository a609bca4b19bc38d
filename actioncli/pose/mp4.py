"""Writing an MP4 that is whole: OpenCV goes on without a word where a disk is full."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2

from actioncli.pose.frames import name_for_opencv, quiet
from actioncli.pose.region import Image


@contextmanager
def mp4_writer(path: Path, rate: float, codecs: Sequence[str]) -> Iterator[Callable[[Image], None]]:
    """What writes frames, BGR images (H, W, 3) of one size, into a file.

    Args:
        path: ends in `.mp4`, which OpenCV goes by.
        rate: frames a second.
        codecs: four letters each; the first that this OpenCV knows is taken.

    Raises:
        OSError: it knows none of them, or the file did not become whole.
    """
    writer: cv2.VideoWriter | None = None

    def write(image: Image) -> None:
        nonlocal writer
        if writer is None:
            writer = _opened(path, rate, codecs, (image.shape[1], image.shape[0]))
        writer.write(image)

    with quiet():
        try:
            yield write
        finally:
            if writer is not None:
                writer.release()
    if not _is_whole(path):
        raise OSError("it came out incomplete, as on a full disk")


def _opened(
    path: Path, rate: float, codecs: Sequence[str], size: tuple[int, int]
) -> cv2.VideoWriter:
    name = name_for_opencv(str(path))
    for codec in codecs:
        writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*codec), rate, size)
        if writer.isOpened():
            return writer
    raise OSError("this OpenCV writes no MP4")


def _is_whole(path: Path) -> bool:
    """Whether boxes (ISO/IEC 14496-12, 4.2) fill the file to its end, the index among them."""
    end, at, kinds = path.stat().st_size, 0, set()
    with path.open("rb") as file:
        while at < end:
            file.seek(at)
            head = file.read(16).ljust(16, b"\0")
            size, kind, large = struct.unpack(">I4sQ", head)
            at += max(large if size == 1 else size, 8)
            kinds.add(kind)
    return at == end and b"moov" in kinds
