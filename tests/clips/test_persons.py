from __future__ import annotations

import numpy as np
import pytest

from actioncli.clips.persons import most_active
from actioncli.clips.recording import Recording
from actioncli.errors import ClipError

from .bodies import waving


def people(*bodies: np.ndarray) -> Recording:
    return Recording(np.stack(bodies, axis=1).astype(np.float32))


def standing(frames: int = 40) -> np.ndarray:
    return np.repeat(waving(frames)[:1], frames, axis=0) + np.array([1.5, 0, 0])


def test_one_person_is_no_choice() -> None:
    recording = people(waving())
    assert most_active(recording, "clip") is recording


def test_the_one_who_moves_is_taken_and_noted() -> None:
    chosen = most_active(people(standing(), waving()), "clip")
    np.testing.assert_array_equal(chosen.positions[:, 0], waving().astype(np.float32))
    assert len(chosen.notes) == 1
    assert chosen.notes[0].startswith("2 people in the file: took person 2, who moves most")


def test_people_in_changing_columns_are_followed() -> None:
    one, other = waving(), standing()
    swapped = np.arange(40) % 3 == 0
    columns = [np.where(swapped[:, None, None], a, b) for a, b in ((one, other), (other, one))]
    chosen = most_active(people(*columns), "clip")
    np.testing.assert_array_equal(chosen.positions[:, 0], one.astype(np.float32))


@pytest.mark.parametrize("nobody", [np.nan, 0.0])
def test_padding_is_nobody(nobody: float) -> None:
    empty = np.full_like(waving(), nobody)
    chosen = most_active(people(empty, waving(), empty), "clip")
    np.testing.assert_array_equal(chosen.positions[:, 0], waving().astype(np.float32))
    assert chosen.notes == ()
    with pytest.raises(ClipError, match="clip: nobody is in it"):
        most_active(people(empty, empty), "clip")


def test_frames_before_and_after_the_person_are_cut() -> None:
    body, empty = waving(), np.full_like(waving(), np.nan)
    body[:5] = body[30:] = np.nan
    chosen = most_active(people(empty, body), "clip")
    np.testing.assert_array_equal(chosen.positions[:, 0], waving()[5:30].astype(np.float32))


def test_one_frame_elsewhere_does_not_win() -> None:
    ghost = np.full_like(waving(), np.nan)
    ghost[4:6] = standing()[4:6] + np.array([2, 0, 0])
    ghost[5] += 0.4
    chosen = most_active(people(ghost, waving()), "clip")
    np.testing.assert_array_equal(chosen.positions[:, 0], waving().astype(np.float32))


def test_somebody_who_comes_later_takes_nobodys_place() -> None:
    # Detectors fill columns from the left: whoever is found alone is in the first.
    one, other = waving(), standing() + np.array([2, 0, 0])
    first, second = one.copy(), other.copy()
    first[:10], second[:10] = other[:10], np.nan
    chosen = most_active(people(first, second), "clip")
    np.testing.assert_array_equal(chosen.positions[:, 0], one[10:].astype(np.float32))


def test_confidence_and_name_follow_the_person() -> None:
    positions = people(standing(), waving()).positions
    confidence = np.stack([np.full((40, 15), 0.25), np.full((40, 15), 0.75)], axis=1)
    recording = Recording(
        positions, confidence=confidence.astype(np.float32), people=("body 7", "body 9")
    )
    chosen = most_active(recording, "clip")
    assert "took body 9" in chosen.notes[0]
    assert chosen.confidence is not None
    assert (chosen.confidence == 0.75).all()


def walking(start: float, speed: float, size: float = 1.0, frames: int = 60) -> np.ndarray:
    """A person who waves and goes across, sized about the feet."""
    body = waving(frames)
    body = body[0].mean(axis=0) + size * (body - body[0].mean(axis=0))
    return body + np.linspace(start, start + speed, frames)[:, None, None] * np.array([1, 0, 0])


RNG = np.random.default_rng(0)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(
    "bodies",
    [
        [waving(60), np.repeat(waving(60)[:1], 60, axis=0) + np.array([0.5, 0, 0])],
        [walking(-1, 2), walking(1, -2, 0.8)],
        [walking(-1, 2, 1.1), walking(0, 0, 0.9), walking(1, -2, 1.0) + np.array([0, 0, 0.3])],
    ],
)
def test_people_within_arms_reach_are_followed(bodies: list[np.ndarray], noise: float) -> None:
    """Columns in any order in each frame, or from left to right."""
    people_ = np.stack(bodies, axis=1) + RNG.normal(0, noise, (60, len(bodies), 15, 3))
    by_place = people_.mean(axis=(2, 3)).argsort(axis=1)
    for order in (RNG.permuted(np.tile(np.arange(len(bodies)), (60, 1)), axis=1), by_place):
        shuffled = people_[np.arange(60)[:, None], order].astype(np.float32)
        chosen = most_active(Recording(shuffled), "clip").positions[:, 0]
        assert any(np.array_equal(chosen, body) for body in people_.swapaxes(0, 1).astype("f4"))


def test_who_cannot_be_told_apart_is_told() -> None:
    alike = [walking(-1, 2), walking(1, -2)]
    assert "too near to be told apart in" in most_active(people(*alike), "clip").notes[-1]
    assert len(most_active(people(alike[0], alike[0] + 1), "clip").notes) == 1
