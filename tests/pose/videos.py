"""Videos for the tests: drawn ones, and frames of real clips."""

import struct
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np

from actioncli.pose.region import Image


def real_frames(path: Path, count: int, every: int = 1) -> list[Image]:
    """The first frames of a video."""
    capture = cv2.VideoCapture(str(path))
    images = []
    for n in range(count * every):
        assert capture.grab()
        if n % every == 0:
            images.append(np.asarray(capture.retrieve()[1], np.uint8))
    return images


def numbered(count: int, width: int = 96, height: int = 64) -> list[Image]:
    """Frames whose lower half shows their number as six black or white bars; white above."""
    images = []
    for n in range(count):
        bars = [255 if n >> bit & 1 else 0 for bit in range(6)]
        image = np.full((height, width, 3), 255, np.uint8)
        image[height // 2 :] = np.repeat(np.array(bars, np.uint8), width // 6)[:, np.newaxis]
        images.append(image)
    return images


def number(image: Image) -> int:
    """Which of the `numbered` frames it is."""
    height, width = image.shape[:2]
    bars = image[3 * height // 4, width // 12 :: width // 6, 0] > 127
    return int(bars @ (1 << np.arange(6)))


def write_video(
    path: Path, images: Iterable[Image], fps: float = 25.0, fourcc: str = "mp4v"
) -> Path:
    writer = None
    for image in images:
        if writer is None:
            size = image.shape[1], image.shape[0]
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*fourcc), fps, size)
            assert writer.isOpened()
        writer.write(image)
    assert writer is not None
    writer.release()
    return path


def rotate_in_header(path: Path) -> None:
    """Make an MP4 one that a phone took upright: the header says a quarter turn clockwise."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4 + 40  # version 0: the matrix follows 40 bytes of fields
    one = 1 << 16
    data[at : at + 36] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


def slow_down_second_half(path: Path, times: int) -> None:
    """Give an MP4 a variable frame rate: the second half's frames last `times` as long."""
    data = bytearray(path.read_bytes())
    at = data.index(b"stts") - 4
    size, _, _, entries, count, delta = struct.unpack(">I4sIIII", data[at : at + 24])
    assert (size, entries) == (24, 1), "the writer made a table of another form"
    half = count // 2
    table = struct.pack(">IIIII", 2, half, delta, count - half, delta * times)
    data[at : at + 24] = struct.pack(">I4sI", 32, b"stts", 0) + table
    for box in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        start = data.index(box) - 4
        grown = struct.unpack(">I", data[start : start + 4])[0] + 8
        data[start : start + 4] = struct.pack(">I", grown)
    data[(edits := data.index(b"edts")) : edits + 4] = b"free"  # it would cut to the old length
    assert data.index(b"mdat") < at, "frames must lie before the header, so that they stay put"
    path.write_bytes(data)


MULTIPART = "multipart/x-mixed-replace; boundary=frame"


def part(picture: Image | bytes, lie: int = 0) -> bytes:
    """A picture, or anything else, as a camera's server sends it; its length wrong by `lie`."""
    content = picture if isinstance(picture, bytes) else cv2.imencode(".jpg", picture)[1].tobytes()
    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(content) + lie}\r\n\r\n"
    return head.encode() + content + b"\r\n"


class Quiet(BaseHTTPRequestHandler):
    """Answers, and writes no line about it."""

    def do_GET(self) -> None:
        self.answer()

    def answer(self) -> None:
        """To whatever is asked for."""
        raise NotImplementedError

    def log_message(self, *_: object) -> None:
        """Nobody reads it."""


@contextmanager
def web_server(handler: type[BaseHTTPRequestHandler], port: int = 0) -> Iterator[str]:
    """The address of a web server on this machine, in a thread."""
    with ThreadingHTTPServer(("127.0.0.1", port), handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def answering(
    *answers: Iterable[bytes | float], kind: str = MULTIPART, port: int = 0
) -> Iterator[str]:
    """The address of a server whose connections get one answer after another, the last one again
    and again: bytes to send, and seconds to wait. Where there is none, it hangs up."""
    over, left = threading.Event(), list(answers)

    class Server(Quiet):
        def answer(self) -> None:
            if not left:
                return
            answer = left.pop(0) if len(left) > 1 else left[0]
            try:
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.end_headers()
                for each in answer:
                    if isinstance(each, bytes):
                        self.wfile.write(each)
                    else:
                        over.wait(each)
                    if over.is_set():
                        return
            except (BrokenPipeError, ConnectionResetError):
                return  # the viewer has gone

    with web_server(Server, port) as address:
        try:
            yield address
        finally:
            over.set()


@contextmanager
def hosted(folder: Path) -> Iterator[str]:
    """The address of a folder on a web server, which answers for parts of files too."""

    class Files(Quiet):
        def answer(self) -> None:
            content = (folder / self.path.strip("/")).read_bytes()
            start = int(self.headers.get("Range", "bytes=0-").removeprefix("bytes=").split("-")[0])
            self.send_response(206)
            self.send_header("Accept-Ranges", "bytes")
            last = len(content) - 1
            self.send_header("Content-Range", f"bytes {start}-{last}/{len(content)}")
            self.send_header("Content-Length", str(len(content) - start))
            self.end_headers()
            try:
                self.wfile.write(content[start:])
            except OSError:
                return  # the viewer has gone

    with web_server(Files) as address:
        yield address


@contextmanager
def streamed(images: Iterable[Image], fps: float, stall: float = 0.0) -> Iterator[str]:
    """The address of a camera on this machine that sends JPEGs at their pace, once, as many
    cameras do.

    Args:
        stall: seconds for which the connection stays open after the last image.
    """

    def sent() -> Iterator[bytes | float]:
        begun = time.monotonic()
        for n, image in enumerate(images):
            yield part(image)
            yield max(begun + (n + 1) / fps - time.monotonic(), 0)
        yield stall

    with answering(sent()) as address:
        yield address
