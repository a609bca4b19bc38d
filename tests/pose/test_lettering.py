"""Letters on images."""

import numpy as np
import pytest

from actioncli.pose.lettering import text_width, write_text


def written(text: str, size: float = 24) -> np.ndarray:
    image = np.zeros((50, 400, 3), np.uint8)
    write_text(image, (10, 36), text, size, (255, 255, 255))
    return image


@pytest.mark.parametrize(
    "text", ["größer", "Χαιρετισμός", "прыжок", "挥手", "手を振る", "흔들기", "שלום"]
)
def test_letters_of_many_scripts_are_drawn(text: str) -> None:
    asked = written("?" * len(text))
    assert (written(text) != asked).any()
    for letter in set(text) - set("abcdefghijklmnopqrstuvwxyz "):
        assert (written(letter) != written("?")).any(), letter


def test_what_no_font_has_is_a_question_mark() -> None:
    for text in ("a\N{WAVING HAND SIGN}", "a\ud800", "a\n", "a\x00"):
        np.testing.assert_array_equal(written(text), written("a?"))


def test_letters_from_right_to_left() -> None:
    """A word ends at its left."""
    last = written("ם")
    end = int(np.flatnonzero(last.any(axis=(0, 2))).max()) + 1
    for text in ("שלום", "שלום a", "שלום שלום"):
        np.testing.assert_array_equal(written(text)[:, :end], last[:, :end])


def test_a_letter_in_parts_is_one() -> None:
    np.testing.assert_array_equal(written("gro\u0308ßer"), written("größer"))


def test_a_line_is_as_wide_as_it_says() -> None:
    for text in ("wave 0.95", "größer", "挥手"):
        columns = np.flatnonzero(written(text).any(axis=(0, 2)))
        assert np.ptp(columns) == pytest.approx(text_width(text, 24), abs=4)
    assert text_width("", 24) == 0
