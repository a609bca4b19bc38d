"""Videos on the command line: enroll, classify, extract and watch."""

import itertools
import json
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from live.servers import broker, free_port, hook, subscribed, until
from pose.videos import answering, hosted, part, streamed, write_video

from actioncli import SupportStore, read_clip
from actioncli.archives.processes import cores
from actioncli.cli import camera
from actioncli.clips.edit import cut
from actioncli.errors import ClipError
from actioncli.pose import video as pose_video
from actioncli.pose.camera import LiveSource
from actioncli.pose.frames import Frame, VideoFile

from .conftest import EXAMPLES, ask, at_terminal, invoke, run

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def waving(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of a real man who raises both arms, small."""
    frames = VideoFile(shared / "video" / "wave_two_hands" / "sudC.avi").frames(end=4, rate=5)
    small = (cv2.resize(frame.image[:, 80:560], (320, 320)) for frame in frames)
    return write_video(tmp_path_factory.mktemp("video") / "wave.mp4", small, 10)


def test_enroll_and_classify_a_video(store: SupportStore, waving: Path) -> None:
    part = ("--start", 0.2, "--end", 1.5)
    done = invoke("enroll", "wave", waving, *part)
    assert done.exit_code == 0, done.stderr
    assert "wave.mp4 added as example 1 (14 frames, 1.3 s)" in done.stdout
    (example,) = store.examples()
    assert (example.joints, example.source) == (33, "wave.mp4")
    assert "already there" in invoke("enroll", "wave", waving, *part).stdout
    assert ask("classify", waving, *part)["clips"][0]["nearest"] == "wave"
    measured = ask("calibrate", "--negatives", waving.parent, "--dry-run")["unknown"]
    assert [row["false_accepts"]["of"] for row in measured if row["kind"] == "negatives"] == [1]


def test_a_video_is_looked_at_once_and_drawn(
    filled: SupportStore, waving: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = []
    look = pose_video._estimate
    monkeypatch.setattr(
        pose_video, "_estimate", lambda *given: looks.append(given[0].path) or look(*given)
    )
    output = tmp_path / "seen.mp4"
    words = ("classify", waving, "--start", 0.2, "--end", 1.5, "--no-cache", "--tau", 1)
    (plain,), (drawn,) = ask(*words)["clips"], ask(*words, "--annotate", output)["clips"]
    assert looks == [waving, waving]
    assert {**plain, "ms": 0} == {**drawn, "ms": 0}
    assert len(list(VideoFile(output).frames())) == 14


@pytest.mark.parametrize("kind", ["npz", "json", "trc", "csv"])
def test_extract(waving: Path, tmp_path: Path, kind: str) -> None:
    file = tmp_path / f"wave.{kind}"
    done = invoke("extract", waving, "-o", file, "--start", 0, "--hands")
    assert done.exit_code == 0, done.stderr
    assert "20 frames, 1.9 s" in done.stdout
    clip = read_clip(file, up="y")
    assert clip.joints.shape == (20, 75, 3)
    assert clip.fps == pytest.approx(10, rel=1e-3)


def test_many_videos_are_read_as_each_alone(waving: Path, tmp_path: Path) -> None:
    """They are shared by processes with one core each."""
    folder, out = tmp_path / "videos", tmp_path / "out"
    folder.mkdir()
    for number in range(2 * cores()):
        (folder / f"{number}.mp4").write_bytes(waving.read_bytes())
    (folder / "0a.mp4").write_bytes(b"no video")
    told = run("extract", folder, "-o", out, "--start", 0, "--json", "--no-cache")
    assert told.returncode == 3
    assert "0a.mp4: not a video" in told.stderr
    found = json.loads(told.stdout)
    assert (found["written"], found["failed"]) == (2 * cores(), 1)
    assert [entry["source"] for entry in found["clips"]] == list(map(str, sorted(folder.iterdir())))
    alone = tmp_path / "alone.npz"
    run("extract", waving, "-o", alone, "--start", 0)
    for file in out.iterdir():
        np.testing.assert_allclose(read_clip(file).joints, read_clip(alone).joints, atol=1e-5)

    enrolled = run("enroll", "wave", folder, "--start", 0, "--json")
    assert enrolled.returncode == 3
    # The same video is the same example.
    assert [json.loads(enrolled.stdout)[key] for key in ("added", "known", "failed")] == [
        1, 2 * cores() - 1, 1,
    ]  # fmt: skip
    classified = run("classify", folder, "--start", 0, "--json")
    clips = json.loads(classified.stdout)["clips"]
    assert [clip.get("nearest") for clip in clips] == ["wave", None, *["wave"] * (2 * cores() - 1)]


def test_watch_a_file(store: SupportStore, waving: Path, tmp_path: Path) -> None:
    invoke("enroll", "wave", waving, "--start", 0)
    script = tmp_path / "script.py"
    script.write_text(
        "import os, sys\n"
        "values = [os.environ['ACTIONCLI_' + name] for name in ('LABEL', 'CONFIDENCE')]\n"
        "open(sys.argv[1], 'a').write(' '.join(values) + '\\n')\n"
    )
    told = tmp_path / "it's told.txt"
    command = f'"{sys.executable}" "{script}" "{told}"'
    first = invoke("watch", waving, "--json", "--tau", 0, "--exec", command)
    assert first.exit_code == 0, first.stderr
    events = [json.loads(line) for line in first.stdout.splitlines()]
    assert {event["label"] for event in events} == {"wave"}
    assert [event["repetitions"] for event in events] == [*range(1, len(events) + 1)]
    assert set(events[0]) == {"label", "start", "end", "confidence", "repetitions", "weights"}
    assert told.read_text().splitlines() == [f"wave {one['confidence']:.3f}" for one in events]
    assert invoke("watch", waving, "--json", "--tau", 0).stdout == first.stdout
    nothing = invoke("watch", waving, "--tau", 1)
    assert nothing.stdout == ""
    assert "no event; a second example, or a lower --tau, tells more" in nothing.stderr
    files = [tmp_path / f"told.{kind}" for kind in ("csv", "srt", "mp4")]
    words = [word for file in files for word in (f"--{file.suffix[1:]}", file)]
    words[4] = "--annotate"
    done = invoke("watch", waving, "--tau", 0, "--sets", *words)
    assert f"wave x{len(events)}  (confidence" in done.stdout if len(events) > 1 else done.stdout
    assert len(files[0].read_text().splitlines()) == 2
    assert "-->" in files[1].read_text()
    assert files[2].stat().st_size > 1000
    again = invoke("watch", waving, "--csv", files[0])
    assert (again.exit_code, files[0].read_text().count("\n")) == (2, 2)
    assert "--force" in again.stderr


def test_watch_sends_what_it_tells(
    store: SupportStore, waving: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("paho.mqtt", reason="needs the extra mqtt")
    pytest.importorskip("amqtt", reason="needs the extra dev")
    store.enroll("wave", read_clip(waving, start=0.2, end=1.5))
    port = free_port()
    monkeypatch.setenv("ACTIONCLI_MQTT", f"mqtt://127.0.0.1:{port}/hall")
    with broker(port), subscribed(port) as got, hook() as server:
        words = ("watch", waving, "--json", "--tau", 0)
        done = invoke(*words, "--webhook", f"http://127.0.0.1:{server.port}/")
        until(lambda: ("hall/status", "offline") in got)
        server.status = None  # hangs from now on
        assert invoke(*words, "--webhook", f"http://127.0.0.1:{server.port}/").stdout == done.stdout
    assert (done.exit_code, done.stderr) == (0, "")
    [event] = map(json.loads, done.stdout.splitlines())
    del event["weights"]
    published = [document for topic, document in got if topic == "hall/action/wave"]
    for document in (*published, *(posted for _, posted in server.posted)):
        assert {**event, "time": document["time"]} == document
    assert (len(published), len(server.posted)) == (2, 2)
    assert "--beep rings the bell of a terminal" in invoke("watch", waving, "--beep").stderr


@pytest.mark.usefixtures("unmeasured")
def test_what_is_enrolled_meanwhile_counts(store: SupportStore, waving: Path) -> None:
    store.enroll("squat", read_clip(EXAMPLES / "squat" / "ada.npz"))
    pictures = [part(frame.image) for frame in VideoFile(waving).frames()]
    always = itertools.cycle([each for picture in pictures for each in (picture, 0.1)])
    words = [sys.executable, "-m", "actioncli", "watch", "--json", "--tau", "0.05"]
    with (
        answering(always) as address,
        subprocess.Popen(
            [*words, address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as watching,
    ):
        assert watching.stdout is not None
        assert watching.stderr is not None
        time.sleep(3)
        assert invoke("enroll", "wave", waving, "--start", 0.2, "--end", 1.5).exit_code == 0
        told = time.monotonic()
        changed = "the support set has changed; enrolled now:"
        assert watching.stderr.readline() == f"note: {address}: {changed} squat, wave\n"
        assert time.monotonic() - told < 1.5
        # Whoever does nothing else is seen to begin; what ends it is that it is removed.
        time.sleep(2)
        assert invoke("remove", "squat", "--yes").exit_code == 0
        assert watching.stderr.readline() == f"note: {address}: {changed} wave\n"
        content = store.path.read_bytes()
        store.path.write_bytes(b"damaged" * 1000)
        assert "What was enrolled before counts until then." in watching.stderr.readline()
        store.path.write_bytes(content)
        assert watching.stderr.readline() == f"note: {address}: {changed} wave\n"
        watching.send_signal(signal.SIGINT)
        events = [json.loads(line) for line in watching.communicate(timeout=60)[0].splitlines()]
    assert watching.returncode == 0
    assert {event["label"] for event in events} == {"wave"}


def test_watch_a_stream_to_its_end(filled: SupportStore, waving: Path, tmp_path: Path) -> None:
    with streamed((frame.image for frame in VideoFile(waving).frames()), fps=10) as address:
        done = invoke("watch", address, "--json", "--tau", 0, "--retry", 0)
    assert done.exit_code == 3, done.stderr
    *events, error = [json.loads(line) for line in json_lines(done.stdout)]
    assert all(0 <= event["start"] < event["end"] < 60 for event in events)
    assert error["error"]["message"] == f"{address}: the picture has ended."


def json_lines(text: str) -> list[str]:
    """Documents on lines of their own; the error at the end takes several."""
    *events, error = text.partition("{\n")[0].splitlines(), text.partition("{\n")[2]
    return [*events[0], "{" + error]


def test_watch_takes_a_stream_up_again(filled: SupportStore, waving: Path, tmp_path: Path) -> None:
    pictures = [part(frame.image) for frame in VideoFile(waving).frames()]
    once: list[bytes | float] = [each for picture in pictures for each in (picture, 0.1)]
    with answering(once, [*once, b"garbage"], []) as address:
        done = invoke("watch", address.replace("//", "//me:secret@"), "--tau", 0, "--retry", 2)
    assert done.exit_code == 3, done.stderr
    again = f"note: {address}: the picture has ended; trying again for 2 s\n"
    lost = f"error: {address}: the picture has ended, and was not back in 2 s.\n"
    assert done.stderr == f"{again}note: {address}: the picture is back\n{again}{lost}"


def test_a_video_at_an_address_is_none_of_a_camera(filled: SupportStore, waving: Path) -> None:
    with hosted(waving.parent) as address:
        done = invoke("watch", f"{address}wave.mp4", "--json", "--tau", 0)
        assert (done.exit_code, done.stdout) == (
            0,
            invoke("watch", waving, "--json", "--tau", 0).stdout,
        )
        refused = invoke("enroll", "wave", "--camera", f"{address}wave.mp4")
        assert refused.exit_code == 2
        assert "wave.mp4: is a file: download it, and enrol it as one" in refused.stderr
        there = f"download it first, or watch it: actioncli watch {address}wave.mp4"
        secret = address.replace("//", "//me:secret@")
        for words in (["classify"], ["enroll", "wave"], ["extract", "-o", waving.parent / "a.npz"]):
            refused = invoke(*words, f"{secret}wave.mp4")
            assert (refused.exit_code, there in refused.stderr) == (3, True), refused.stderr


def test_cameras(waving: Path, tmp_path: Path) -> None:
    pictures: list[bytes | float] = [part(frame.image) for frame in VideoFile(waving).frames()]
    with answering([*pictures, 60.0]) as address:
        words = ("cameras", address, waving, "/dev/null", "--stills", tmp_path)
        document, done = ask(*words), invoke(*words)
    at_address, video, device = document["cameras"]
    for entry in (at_address, video):
        still = Path(entry["still"])
        assert cv2.imread(str(still)).shape[:2] == (entry["height"], entry["width"]) == (320, 320)
        assert still.stat().st_mode & 0o777 == 0o600
    assert "/dev/null: cannot be opened" in device["error"]["message"]
    assert done.exit_code == 3
    assert f"{address}  320 x 320\n" in done.stdout
    assert invoke("cameras").exit_code == 0  # whatever this machine has
    assert invoke("cameras", "--stills", tmp_path / "none").exit_code == 2


def test_cameras_draws_on_a_terminal(waving: Path) -> None:
    shown, code = on_terminal(waving, command="cameras")
    assert code == 0
    rows = [line for line in screen_lines(shown) if set(line) == {"\u2580"}]
    assert len(rows) == 24


@pytest.mark.parametrize("ending", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_ends_reading_a_video_leaves_nothing(
    shared: Path, tmp_path: Path, home: Path, ending: str
) -> None:
    video = shared / "video" / "wave_two_hands" / "sudC.avi"
    reading = f"import signal, sys; sys.argv[1:] = {['extract', str(video), '-o', 'a.npz']!r}\n"
    # Interrupted for certain in the middle: by the frame that is looked at fifth.
    reading += (
        "from actioncli.pose.tracker import Tracker as T\n"
        "look, times = T.__call__, []\n"
        "def looked(*words):\n"
        "    times.append(words[-1])\n"
        f"    if len(times) == 5: signal.raise_signal(signal.{ending})\n"
        "    return look(*words)\n"
        "T.__call__ = looked\n"
        "from actioncli.__main__ import main\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", reading], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("ending", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_ends_watching_ends_it_well(filled: SupportStore, waving: Path, ending: str) -> None:
    sent = threading.Event()

    def images() -> Iterator[np.ndarray]:
        for frame in VideoFile(waving).frames():
            yield frame.image
        sent.set()

    words = [sys.executable, "-m", "actioncli", "watch", "--json", "--tau", "0"]
    with (
        streamed(images(), fps=10, stall=60) as address,
        subprocess.Popen(
            [*words, address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as watching,
    ):
        assert sent.wait(100)
        watching.send_signal(signal.Signals[ending])
        told, complaint = watching.communicate(timeout=60)
    assert (watching.returncode, complaint) == (0, "")
    for line in told.splitlines():
        assert json.loads(line)["label"]


def test_watch_keeps_what_it_told(store: SupportStore, waving: Path, tmp_path: Path) -> None:
    invoke("enroll", "wave", waving, "--start", 0)
    folder = tmp_path / "seen"
    told = json.loads(invoke("watch", waving, "--json", "--tau", 0, "--record", folder).stdout)
    [kept] = json.loads(invoke("review", folder, "--json").stdout)["clips"]
    assert told.pop("weights")
    assert told.pop("repetitions") == 1
    assert {key: kept[key] for key in told} == told
    assert kept["event"] is True
    clip = read_clip(kept["file"])
    assert clip.duration == pytest.approx(told["end"] - told["start"], abs=0.15)
    assert invoke("enroll", "wave", kept["file"]).exit_code == 0


def test_several_processes_look_at_the_same_video(waving: Path, home: Path) -> None:
    words = [sys.executable, "-m", "actioncli", "extract", str(waving), "--start", "0"]
    running = [
        subprocess.Popen([*words, "-o", str(home.parent / f"{n}.npz")], stderr=subprocess.PIPE)
        for n in range(2)
    ]
    for process in running:
        _, complaint = process.communicate(timeout=120)
        assert process.returncode == 0, complaint
    first, second = (read_clip(home.parent / f"{n}.npz").joints for n in range(2))
    np.testing.assert_array_equal(first, second)
    assert [path.suffix for path in (home / "poses").glob("[!.]*")] == [".npz"]


def test_watch_tells_what_there_was_not(filled: SupportStore, tmp_path: Path) -> None:
    picture, empty = tmp_path / "one.png", tmp_path / "empty.avi"
    cv2.imwrite(str(picture), np.zeros((64, 64, 3), np.uint8))
    done = invoke("watch", picture)
    assert done.exit_code == 3
    assert "one.png: one frame; an action needs a moving sequence" in done.stderr
    write_video(
        empty, np.random.default_rng(0).integers(0, 255, (20, 64, 64, 3), np.uint8), 10, "MJPG"
    )
    empty.write_bytes(empty.read_bytes()[: empty.stat().st_size // 2])
    done = invoke("watch", empty)
    assert (done.exit_code, done.stdout) == (0, "")
    assert "the file announces 20 frames and" in done.stderr
    assert "nobody was seen in any of" in done.stderr
    assert "s that the quickest performance would take" in done.stderr


def on_terminal(
    waving: Path, *more: str, command: str = "watch", streams: Sequence[str] = ("stdout", "stderr")
) -> tuple[bytes, int]:
    """What a command writes to a terminal, and its exit code."""
    words = [sys.executable, "-m", "actioncli", command, str(waving), *more]
    done, shown = at_terminal(words, *streams)
    return shown, done.returncode


def screen_lines(shown: bytes) -> list[str]:
    """What is left on the screen."""
    pyte = pytest.importorskip("pyte", reason="needs the extra dev")
    screen = pyte.Screen(100, 40)
    pyte.ByteStream(screen).feed(shown)
    return [line.strip() for line in screen.display if line.strip()]


def test_watch_shows_a_terminal_what_it_sees(store: SupportStore, waving: Path) -> None:
    store.enroll("squat", cut(read_clip(EXAMPLES / "squat" / "ada.npz"), 0.5, 1.5))
    shown, code = on_terminal(waving, "--json", streams=["stderr"])
    assert code == 0
    text = shown.decode()
    assert re.search(r"\d+\.\d s +\d+\.\d frames/s +\d+ s left +following", text), text
    assert re.search(r"squat +[01]\.\d\d", text)


def test_a_person_at_a_terminal_sees_the_events(store: SupportStore, waving: Path) -> None:
    """Both streams go to one terminal, as they do for who just types the command."""
    store.enroll(":wave:", read_clip(waving, start=0.2, end=1.5))
    moved = shlex.join([sys.executable, "-c", "print('moved')"])
    shown, code = on_terminal(waving, "--tau", "0", "--beep", "--exec", moved)
    assert (code, shown.count(b"\a")) == (0, 1)
    event = r"\d+\.\d s  to +\d+\.\d s  :wave:  \(confidence [01]\.\d\d\)"
    first, *rest = screen_lines(shown)
    assert re.fullmatch(event, first), first
    assert rest == ["moved"]  # and the view is gone


def test_a_person_at_a_terminal_sees_the_notes(filled: SupportStore, tmp_path: Path) -> None:
    grey = write_video(tmp_path / "a.mp4", [np.full((64, 64, 3), 128, np.uint8)] * 40, 10)
    shown, code = on_terminal(grey)
    assert code == 0
    [seen] = re.findall(r"note: .*", "".join(screen_lines(shown)))
    assert seen.replace(" ", "").endswith("a.mp4:nobodywasseeninanyof40frames")  # over two lines


class Paced(LiveSource):
    """A camera that shows a video: frames at the times at which they would come."""

    dropped = 0
    video: Path

    def __init__(self, source: int, *_: object) -> None:
        self.name = f"camera {source}"

    def frames(self) -> Iterator[Frame | float]:
        for frame in VideoFile(self.video).frames():
            time.sleep(0.01)
            yield frame
        raise ClipError(f"{self.name}: the picture has ended.")

    def close(self) -> None:
        """Nothing is held."""


@pytest.fixture
def at_camera(monkeypatch: pytest.MonkeyPatch) -> type[Paced]:
    monkeypatch.setattr("actioncli.pose.camera.LiveSource", Paced)
    monkeypatch.setattr(camera, "COUNTDOWN", 0.3)
    return Paced


@pytest.mark.parametrize(
    ("seconds", "seen", "message"),
    [
        (1, True, None),
        (10, True, "camera 0: the picture has ended. Of 10 s, 17 frames were recorded; nothing is"),
        (1, False, "not in view in 11 of 11 frames; nothing is enrolled"),
    ],
)
def test_record(
    store: SupportStore, waving: Path, at_camera: type[Paced], tmp_path: Path,
    seconds: float, seen: bool, message: str | None,
) -> None:  # fmt: skip
    grey = [np.full((64, 64, 3), 128, np.uint8)] * 20
    at_camera.video = waving if seen else write_video(tmp_path / "empty.avi", grey, 10, "MJPG")
    done = invoke("enroll", "wave", "--camera", 0, "--seconds", seconds)
    if message is not None:
        assert (done.exit_code, message in done.stderr) == (3, True), done.stderr
        assert store.examples() == []
        return
    assert done.exit_code == 0, done.stderr
    (example,) = store.examples()
    assert (example.source, example.frames) == ("camera 0", 11)


def part_of(video: Path, copy: Path, seconds: float) -> Path:
    """The beginning of a real video, small and at ten frames a second."""

    def squares() -> Iterator[np.ndarray]:
        for frame in VideoFile(video).frames(end=seconds, rate=10):
            height, width = frame.image.shape[:2]
            scale = 360 / max(height, width)
            small = cv2.resize(frame.image, (round(width * scale), round(height * scale)))
            square = np.zeros((360, 360, 3), np.uint8)
            top, left = (360 - small.shape[0]) // 2, (360 - small.shape[1]) // 2
            square[top : top + small.shape[0], left : left + small.shape[1]] = small
            yield square

    return write_video(copy, squares(), 10)


def test_the_commands_of_the_documents(
    shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_camera: type[Paced]
) -> None:
    """How to begin, in order; a recorded person stands before the camera."""
    monkeypatch.chdir(tmp_path)
    videos = shared / "video"
    part_of(videos / "squat" / "darebeeW.mp4", tmp_path / "squat.mp4", 4)
    part_of(videos / "squat" / "momokaM.mp4", tmp_path / "query.mp4", 4)
    at_camera.video = part_of(videos / "wave_two_hands" / "sudC.avi", tmp_path / "live.mp4", 4.5)
    part_of(videos / "wave_two_hands" / "sudC.avi", tmp_path / "wave.mp4", 4)
    commands = []
    for page, titles in (("README.md", ["Three commands"]), ("docs/index.md", ["Enrol", "Watch"])):
        for title in titles:
            text = (ROOT / page).read_text(encoding="utf-8").split(f"\n## {title}\n")[1]
            for block in re.findall(r"```sh\n(.+?)```", text.split("\n## ")[0], re.DOTALL):
                commands += re.findall(r"^actioncli .+$", block, re.MULTILINE)
    assert len(commands) >= 7
    for line in commands:
        _, name, *words = shlex.split(line, comments=True)
        if name == "studio" or "--page" in words:  # they serve until stopped: see tests/studio
            continue
        if name == "review":  # whose keys tests/cli/test_review.py presses
            words.append("--json")
        done = invoke(name, *words)
        # 1: somebody else's squat may be rejected. 3: the camera has an end.
        codes = {"classify": (0, 1), "watch": (3,)}.get(name, (0,))
        assert done.exit_code in codes, (line, done.stderr)
    labels = json.loads(invoke("list-support", "--json").stdout)["actions"]
    assert {"squat", "wave"} <= {action["label"] for action in labels}
