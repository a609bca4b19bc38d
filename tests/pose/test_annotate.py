from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actioncli.errors import ClipError
from actioncli.pose.annotate import annotate_video, bones
from actioncli.pose.frames import VideoFile
from actioncli.pose.poses import Poses
from actioncli.pose.sides import ALL_NAMES
from actioncli.pose.video import Progress
from tests.forking import files_up_to

from .videos import numbered, slow_down_second_half, write_video


def standing(frames: int) -> Poses:
    """Somebody whose landmarks lie on a diagonal of a 96 by 64 image."""
    points = np.tile(np.linspace((10, 20), (80, 60), 33), (frames, 1, 1)).astype(np.float32)
    times = np.arange(frames) / 25
    world = np.random.default_rng(0).random((frames, 33, 3), np.float32)
    visible = np.ones((frames, 33), np.float32)
    return Poses(times, world, visible, points, times, (96, 64))


def test_bones_join_each_side() -> None:
    joined = {(ALL_NAMES[a], ALL_NAMES[b]) for a, b, _ in bones()}
    assert {("lsho", "rsho"), ("lhip", "lkne"), ("rhip", "rkne"), ("relb", "rwri")} <= joined
    assert {("lhand0", "lhand5"), ("rhand19", "rhand20")} <= joined
    assert all(
        a[0] == b[0] for a, b in joined - {("lsho", "rsho"), ("lhip", "rhip")} if a != "nose"
    )


def test_every_frame_with_a_skeleton(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", [np.full((64, 96, 3), 90, np.uint8)] * 12)
    assert annotate_video(video, tmp_path / "out.mp4", standing(12), lambda _: ["wave"]) == 12
    images = [frame.image for frame in VideoFile(tmp_path / "out.mp4").frames()]
    assert len(images) == 12
    assert all(np.ptp(image[30:]) > 100 for image in images)  # the skeleton
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mp4", "out.mp4"]


def test_accepted_and_rejected_have_a_sign_and_a_colour(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", [np.full((240, 320, 3), 90, np.uint8)] * 3)
    signs, plain = [], []
    for line in ("✓ wave", "✗ wave", "wave"):
        annotate_video(video, tmp_path / "out.mp4", standing(3), lambda _, line=line: [line])
        image = next(iter(VideoFile(tmp_path / "out.mp4").frames())).image.astype(int)
        _, green, red = image[:18, :60].max(axis=(0, 1))
        signs.append("green" if green > red + 50 else "red" if red > green + 50 else "")
        plain.append(int((image[:18, :16].max(axis=2) > 130).sum()))
    assert signs == ["green", "red", ""]
    assert min(plain) > 10
    assert plain[0] != plain[1]


def test_a_long_label_fits_into_a_narrow_video(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", [np.full((320, 180, 3), 90, np.uint8)] * 3)
    annotate_video(video, tmp_path / "out.mp4", standing(3), lambda _: [f"✓ {'größer' * 4}"])
    image = next(iter(VideoFile(tmp_path / "out.mp4").frames())).image[:16].max(axis=2)
    assert (image[:, 110:168] > 100).any()
    assert (image[:, 172:] < 60).all()


def test_fingers_of_a_hand_that_was_seen(tmp_path: Path) -> None:
    """Both hands' fingers lie below the skeleton; only the left hand was seen, and in half."""
    video = write_video(tmp_path / "in.mp4", [np.full((64, 96, 3), 90, np.uint8)] * 12)
    body = standing(12)
    points = np.tile(np.linspace((10, 62), (80, 62), 42), (12, 1, 1)).astype(np.float32)
    visible = np.zeros((12, 42), np.float32)
    visible[:6, :21] = 0.9
    poses = replace(
        body,
        points=np.concatenate([body.points.clip(max=40), points], axis=1),
        visibility=np.concatenate([body.visibility, visible], axis=1),
        world=np.zeros((12, 75, 3), np.float32),
    )
    annotate_video(video, tmp_path / "out.mp4", poses, lambda _: ["wave"])
    below = [frame.image[60:] for frame in VideoFile(tmp_path / "out.mp4").frames()]
    drawn = [(np.ptp(image[:, 12:40]) > 60, np.ptp(image[:, 55:]) > 60) for image in below]
    assert drawn == [(True, False)] * 6 + [(False, False)] * 6


def test_frames_that_last_longer_do_so_in_the_copy(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", numbered(12), 25)
    slow_down_second_half(video, 3)
    told: list[Progress] = []
    annotate_video(video, tmp_path / "out.mp4", standing(24), lambda _: ["wave"], told.append)
    frames = list(VideoFile(tmp_path / "out.mp4").frames())
    assert frames[-1].time == pytest.approx(0.84, abs=0.09)  # as in the original
    assert [step.frames for step in told] == list(range(1, 13))
    assert told[-1].seconds <= told[-1].total == pytest.approx(23 / 25)


def test_only_the_part_that_was_looked_at(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", numbered(30))
    poses = standing(30).between(0.4, 0.8)
    assert annotate_video(video, tmp_path / "out.mp4", poses, lambda _: ["größer"]) == 11


def test_nobody_no_skeleton(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", [np.full((64, 96, 3), 90, np.uint8)] * 40)
    seen = standing(40)
    short = Poses(
        seen.times[:5], seen.world[:5], seen.visibility[:5], seen.points[:5], seen.frames, (96, 64)
    )
    annotate_video(video, tmp_path / "out.mp4", short, lambda _: ["a"])
    last = [frame.image for frame in VideoFile(tmp_path / "out.mp4").frames()][-1]
    assert np.ptp(last[40:]) < 40


def test_no_folder(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", numbered(3))
    with pytest.raises(ClipError, match="cannot be written"):
        annotate_video(video, tmp_path / "no" / "out.mp4", standing(3), lambda _: ["a"])


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    video = write_video(tmp_path / "in.mp4", numbered(12))
    (tmp_path / "out.mp4").write_text("mine")
    with files_up_to(1000), pytest.raises(ClipError, match=r"cannot be written: .* full disk"):
        annotate_video(video, tmp_path / "out.mp4", standing(12), lambda _: ["a"])
    assert (tmp_path / "out.mp4").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 2


def test_frames_of_years_fill_no_disk(tmp_path: Path) -> None:
    """As where a header states a rate, and the frames their own times."""
    video = write_video(tmp_path / "in.mp4", numbered(12))
    poses = replace(standing(12), frames=np.geomspace(1, 1e6, 12))
    with pytest.raises(ClipError, match=r"has 12 frames in 999,999 s.* narrow the time down"):
        annotate_video(video, tmp_path / "out.mp4", poses, lambda _: ["a"])
