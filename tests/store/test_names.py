"""Labels, file names and notes."""

import unicodedata
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.errors import UsageError
from actioncli.store.names import check_label, file_name, plain_text


@pytest.mark.parametrize(
    ("given_label", "stored"),
    [
        ("wave", "wave"),
        ("  wave both hands ", "wave both hands"),
        ("挥手", "挥手"),
        ("手 を 振る", "手 を 振る"),
        ("cafe\u0301", "café"),
        ("rm -rf; $(x) `y` \"z\" 'a' ../../b", "rm -rf; $(x) `y` \"z\" 'a' ../../b"),
        ("x" * 100, "x" * 100),
        ("🤷", "🤷"),
    ],
)
def test_labels_are_taken(given_label: str, stored: str) -> None:
    assert check_label(given_label) == stored


@pytest.mark.parametrize(
    "label",
    ["", "   ", "\n", "x" * 101, "a\nb", "a\tb", "\x1b[31mred", "a\x00b", "\u202egnp.exe",
     "zero\u200bwidth", "line\u2028break", "\ud800", "\x9b1m", "\ufeffbom"],
)  # fmt: skip
def test_labels_are_refused(label: str) -> None:
    with pytest.raises(UsageError) as error:
        check_label(label)
    assert error.value.exit_code == 2
    assert str(error.value).isprintable()


def test_label_of_another_type_is_refused() -> None:
    with pytest.raises(UsageError, match="must be text"):
        check_label(cast("str", 3))


@given(st.text(st.characters(), max_size=120))
def test_stored_labels_are_safe_and_stable(text: str) -> None:
    try:
        label = check_label(text)
    except UsageError:
        return
    assert 1 <= len(label) <= 100
    assert label == label.strip() == check_label(label)
    assert not any(unicodedata.category(character).startswith("C") for character in label)
    assert len(label.splitlines()) == 1


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("/home/anna/secret/wave.npy", "wave.npy"),
        ("C:\\Users\\anna\\wave.npy", "wave.npy"),
        ("wave.npy", "wave.npy"),
        ("folder/", "folder"),
        ("../..", ""),
        ("", ""),
        ("camera 0", "camera 0"),
        ("/x/\x1b]0;title\x07wave.npy", "]0;title wave.npy"),
        ("x" * 300, "x" * 255),
    ],
)
def test_sources_lose_their_folder(source: str, name: str) -> None:
    assert file_name(source) == name


@given(st.text(st.characters()))
def test_sources_and_notes_are_one_printable_line(text: str) -> None:
    for cleaned in (file_name(text), plain_text(text)):
        assert not any(unicodedata.category(character).startswith("C") for character in cleaned)
        assert len(cleaned.splitlines()) <= 1
    assert "/" not in file_name(text)
    assert file_name(file_name(text)) == file_name(text)
    assert plain_text(plain_text(text)) == plain_text(text)
    assert len(plain_text(text)) <= 500
