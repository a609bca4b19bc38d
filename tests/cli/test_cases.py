"""Recordings and calls that went wrong once, folder by folder, and what is said to each now."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from pose.videos import write_video

from actioncli import Clip, SupportSet, SupportStore, read_clip
from actioncli.clips.checks import noted, require_usable
from actioncli.clips.view import view_notes
from actioncli.errors import ClipError
from actioncli.live.watching import watch
from actioncli.pose.frames import VideoFile

from .conftest import EXAMPLES, invoke, run

# File and options to part of a note or, where it cannot be read, of the error; "" where nothing
# is to be said. A star stands before what is refused as an example, too.
ANSWERS = {
    "guessed_legs/bow_ben.npz": "legs are not in view",
    "guessed_legs/jumping_jack_dev.npz": "legs are not in view",
    "guessed_legs/kick_right_ada.npz": "*legs are not in view",
    "guessed_legs/kick_right_cleo.npz": "*legs are not in view",
    "guessed_legs/squat_ada.npz": "legs are not in view",
    "guessed_legs/squat_ben.npz": "legs are not in view",
    "json_of_tools/azure_kinect.json": "",
    "json_of_tools/frames_keypoints_by_name.json": "",
    "json_of_tools/long_table.csv": "",
    "json_of_tools/mediapipe_world_landmarks.json": "",
    "json_of_tools/openpose_frame.json": "*give actioncli the video",
    "no_head/head_is_end_site.bvh": "",
    "no_head/opencap.trc": "has no head, which counts as not seen",
    "not_3d/angles_in_degrees.csv": "*these may be angles",
    "not_3d/image_landmarks_near.npy": "*has no depth",
    "not_3d/image_x_y_visibility.npy": "*a score or a visibility",
    "not_3d/noise.npy": "*bones change their length",
    "not_3d/pixels_and_score.npy": "*has no depth",
    "not_3d/sports2d_flat.trc": "*has no depth",
    "two_people/crossing_sorted_left_to_right.npz": "took person 2",
    "two_people/squat_and_jacks_0.8_random.npz": "took person 2",
    "two_people/squat_and_still_1.2_random.npz": "took person 1",
    "upside_down/wave_on_its_head.npz": "is the video rotated",
    "upside_down/wave_sideways.npz": "is the video rotated",
    "wrong/confidence_nan.npz": "*confidence is NaN for 100.0% of the joint positions",
    "wrong/confidence_zero.npz": "*confidence is 0",
    "wrong/flat2d.npz": "*has no depth",
    "wrong/legs_nan.npz": "not seen: lkne in 100%",
    "wrong/legs_zero.npz": "not seen: lkne in 100%",
    # A body in space, whose size changes no decision.
    "wrong/pixels_like.npz": "",
    "wrong/upside.npz --up -y": "the head is below the feet in 100%",
}


def answer(file: Path, up: str | None) -> tuple[list[str], bool]:
    """What is said of a file, and whether it is refused as an example."""
    try:
        clip = noted(read_clip(file, up=up))
    except ClipError as error:
        return [str(error)], True
    said = [*clip.notes, *view_notes(clip)]
    try:
        require_usable(clip)
    except ClipError:
        return said, True
    return said, False


@pytest.mark.parametrize("case", ANSWERS)
def test_files(shared: Path, case: str) -> None:
    name, *options = case.split()
    said, refused = answer(shared / "cases" / name, options[-1] if options else None)
    wanted = ANSWERS[case]
    assert refused == wanted.startswith("*")
    if wanted:
        assert wanted.removeprefix("*") in "; ".join(said)
    else:
        assert [each for each in said if not re.search("inferred|not stated", each)] == []


def test_two_people_are_followed(shared: Path) -> None:
    """The jumper is half as tall again as who squats: no frame shows the other."""
    for file in sorted((shared / "cases" / "two_people").glob("*.npz")):
        clip = read_clip(file)
        ends = [clip.joints[:, clip.joint_names.index(name)] for name in ("neck", "pelv")]
        torso = np.linalg.norm(ends[0] - ends[1], axis=1)
        assert torso.max() < 1.1 * torso.min(), file


def test_every_folder_has_its_test(shared: Path) -> None:
    asked = {case.partition("/")[0] for case in ANSWERS}
    asked |= {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {folder.name for folder in (shared / "cases").iterdir()} <= asked


def test_address_lost_slash(filled: SupportStore) -> None:
    done = invoke("classify", "https://example.org/v.mp4")
    assert "https://example.org/v.mp4: is an address" in done.stderr
    assert "cannot be opened" in invoke("watch", "http://127.0.0.1:1/file.mp4").stderr


def test_batch_csv(filled: SupportStore, tmp_path: Path) -> None:
    assert invoke("batch", EXAMPLES / "squat", tmp_path / "out.csv").exit_code == 0
    assert (tmp_path / "out.csv").read_text(encoding="utf-8").startswith("source,label")
    assert invoke("batch", EXAMPLES / "squat", tmp_path / "out.txt").exit_code == 2


@pytest.mark.parametrize("camera", ["/dev/video63", "rtsp://127.0.0.1:1/stream"])
def test_camera_path(camera: str) -> None:
    done = invoke("enroll", "wave", "--camera", camera)
    assert (done.exit_code, "not a valid int" in done.stderr) == (3, False)
    assert f"{camera}: cannot be opened" in done.stderr


def test_same_name_folder(shared: Path, tmp_path: Path) -> None:
    for number, folder in enumerate(("two/a", "two/b")):
        (tmp_path / folder).mkdir(parents=True)
        video = VideoFile(shared / "video" / "wave_two_hands" / "sudC.avi")
        frames = video.frames(start=number, end=number + 1, rate=8)
        small = (cv2.resize(frame.image[:, 80:560], (320, 320)) for frame in frames)
        write_video(tmp_path / folder / "v.mp4", small, 8)
    done = run("extract", "two", "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = sorted(str(file.relative_to(tmp_path)) for file in tmp_path.glob("out/**/*.npz"))
    assert found == ["out/a/v.npz", "out/b/v.npz"]
    shutil.copy(EXAMPLES / "squat" / "ada.npz", tmp_path / "mine.npz")
    done = run("extract", "two/a/v.mp4", "-o", "mine.npz", cwd=tmp_path)
    assert (done.returncode, "--force" in done.stderr) == (2, True)


def stills(shared: Path, at: float, frames: int) -> list[np.ndarray]:
    """One picture of a person, over and over, with a camera's noise."""
    video = VideoFile(shared / "video" / "wave_two_hands" / "sudC.avi")
    image = cv2.resize(next(video.frames(start=at)).image[:, 80:560], (320, 320)).astype(int)
    noise = np.random.default_rng(0)
    return [
        np.clip(image + noise.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
        for _ in range(frames)
    ]


@pytest.mark.parametrize(
    ("video", "below", "of_legs"),
    [
        ("squat/momokaM.mp4", 440, True),
        ("lunge/aitW2.mp4", 372, True),
        ("clap/sudB.avi", 246, False),
    ],
)
def test_legs_that_a_video_does_not_show(
    shared: Path, tmp_path: Path, video: str, below: int, of_legs: bool
) -> None:
    """As at a desk: the picture ends at the waist."""
    whole = shared / "video" / video
    file = VideoFile(whole)
    images = [frame.image[:below, : frame.image.shape[1] // 2 * 2] for frame in file.frames()]
    desk = write_video(tmp_path / "desk.mp4", images, file.fps)
    done = invoke("enroll", "at a desk", desk)
    assert ("not in view" in done.stderr, done.exit_code) == (True, 3 if of_legs else 0)
    assert invoke("enroll", "whole", whole, "--store", tmp_path / "whole.db").exit_code == 0
    asked = invoke("classify", desk, "--store", tmp_path / "whole.db")
    assert asked.exit_code == (1 if of_legs else 0), asked.stdout


def test_still_person(shared: Path, tmp_path: Path) -> None:
    video = write_video(tmp_path / "still.mp4", stills(shared, 2, 24), 8)
    for part in (("--start", 0, "--end", 3), ("--start", 0, "--end", 0.2), ()):
        done = invoke("enroll", "wave", video, *part)
        assert done.exit_code == 3, done.stdout
        assert re.search("nobody moves|which is no action", done.stderr)


def test_stream_lost(shared: Path, filled: SupportStore, tmp_path: Path) -> None:
    for number, image in enumerate(stills(shared, 1, 3)):
        cv2.imwrite(str(tmp_path / f"{number}.jpg"), image)
    words = [
        sys.executable,
        shared / "cases" / "stream_lost" / "server.py",
        "18766",
        "20",
        tmp_path,
    ]
    with subprocess.Popen([*map(str, words)], stderr=subprocess.DEVNULL) as server:
        try:
            for _ in range(50):
                done = run("watch", "http://127.0.0.1:18766/x.mjpg", "--retry", 0)
                if "cannot be opened" not in done.stderr:
                    break
        finally:
            server.terminate()
    assert done.returncode == 3
    assert "127.0.0.1:18766" in done.stderr
    assert "-0.0 s" not in done.stdout


def test_watch_repeats(shared: Path) -> None:
    support = SupportSet.from_clips(
        {label: [read_clip(EXAMPLES / label / "ada.npz")] for label in ("wave_right", "squat")}
    )
    wave = read_clip(EXAMPLES / "wave_right" / "cleo.npz")
    rest = np.repeat(wave.joints[-1:], round(wave.fps), axis=0)
    rest = rest + np.random.default_rng(0).normal(0, 0.002, rest.shape)
    parts = itertools.chain.from_iterable([rest, wave.joints] for _ in range(3))
    stream = Clip(np.concatenate([rest, *parts, rest, rest]), wave.joint_names, wave.fps)
    assert [event.label for event in watch(stream, support)] == ["wave_right"] * 3
