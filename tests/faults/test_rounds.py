"""Rounds of faults: 60 with every run of the tests, 1,000 at night."""

import sys
from pathlib import Path

import pytest
from rounds import play

PART = 10


def play_all(first: int) -> None:
    """Play some rounds; a failure says how to repeat it."""
    for seed in range(first, first + PART):
        well, told = play(seed)
        again = f"{sys.executable} {Path(__file__).with_name('rounds.py')} {seed}"
        assert well, f"round {seed}: {told}\nRepeat it with: {again}"


@pytest.mark.parametrize("first", range(0, 60, PART))
def test_rounds(first: int) -> None:
    play_all(first)


@pytest.mark.nightly
@pytest.mark.parametrize("first", range(1000, 2000, PART))
def test_nightly_rounds(first: int) -> None:
    play_all(first)
