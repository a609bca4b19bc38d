"""Watching for an hour, through breaks, refusals and changes: memory, threads and files stay flat.

SOAK_SECONDS makes it shorter.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import cv2
import pytest

from actioncli import SupportStore, enrol, read_clip
from actioncli.pose.frames import VideoFile
from actioncli.recognition.recognizer import Recognizer
from tests.pose.videos import answering, part

from .servers import hook

EXAMPLES = Path(__file__).parents[2] / "examples"
SECONDS = float(os.environ.get("SOAK_SECONDS", "3600"))
SAMPLES = 90
# Frames a second.
RATE = 15
# Where memory is given back differs from run to run by this share, and by so many kilobytes.
SHARE, SPARE = 1.02, 6000


class Film:
    """A video over and over; each connection shows it for a while, and breaks in another way."""

    def __init__(self, pictures: list[bytes], breaks: int) -> None:
        self._pictures, self._shown = pictures, round(RATE * SECONDS / breaks)
        self._breaks: Iterator[bytes | float] = itertools.cycle([b"garbage" * 100, 8.0, b""])

    def __iter__(self) -> Iterator[bytes | float]:
        for picture in itertools.islice(itertools.cycle(self._pictures), self._shown):
            yield picture
            yield 1 / RATE
        yield next(self._breaks)


def used(process: int) -> tuple[int, int, int]:
    """Kilobytes, threads and open files of a process."""
    folder = Path(f"/proc/{process}")
    lines = (folder / "status").read_text().splitlines()
    status = dict(line.split(":", 1) for line in lines)
    files = len(list((folder / "fd").iterdir()))
    return int(status["VmRSS"].split()[0]), int(status["Threads"]), files


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_an_hour_leaves_memory_threads_and_files_flat(real_videos: Path, tmp_path: Path) -> None:
    film = real_videos / "wave_two_hands" / "sudC.avi"
    frames = VideoFile(film).frames(end=4, rate=RATE)
    pictures = [part(cv2.resize(frame.image[:, 80:560], (320, 320))) for frame in frames]
    store = SupportStore(tmp_path / "support.db")
    recognizer = Recognizer()
    enrol(store, recognizer, "wave", [read_clip(film, start=0.5, end=2.5)])
    squat = read_clip(EXAMPLES / "squat" / "ada.npz")
    words = [sys.executable, "-m", "actioncli", "watch", "--json", "--store", str(store.path)]
    words += ["--record", str(tmp_path / "seen"), "--exec", "true", "--tau", "0.3"]
    samples, counts = [], itertools.count()
    with (
        answering(Film(pictures, 12)) as address,
        hook() as server,
        (tmp_path / "told").open("w") as told,
        subprocess.Popen(
            [*words, address, "--webhook", f"http://127.0.0.1:{server.port}/"],
            stdout=told,
            stderr=subprocess.DEVNULL,
        ) as watching,
    ):
        begun = time.monotonic()
        while (passed := time.monotonic() - begun) < SECONDS:
            time.sleep(SECONDS / SAMPLES)
            assert watching.poll() is None, passed
            samples.append(used(watching.pid))
            number = next(counts)
            server.status = (200, 200, 500)[number % 3]
            if number % 4 == 1:
                enrol(store, recognizer, "squat", [squat])
            elif number % 4 == 3:
                store.remove("squat")
        watching.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            watching.wait(60)
    assert watching.returncode == 0
    events = [json.loads(line) for line in (tmp_path / "told").read_text().splitlines()]
    assert len(events) > SECONDS / 60
    assert server.posted
    (tmp_path / "used.json").write_text(json.dumps(samples))
    # The first third is what it takes to be under way.
    third = len(samples) // 3
    kilobytes, threads, files = (
        [median(each[kind] for each in samples[at : at + third]) for at in (third, 2 * third)]
        for kind in range(3)
    )
    assert kilobytes[1] < SHARE * kilobytes[0] + SPARE, samples
    assert threads[1] <= threads[0] + 1, samples
    assert files[1] <= files[0] + 1, samples
