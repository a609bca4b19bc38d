from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.files import Numbers, number, text_lines
from actioncli.clips.recording import LARGEST_CLIP
from actioncli.errors import ClipError


def test_lines_of_any_ending_and_encoding(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        for end in ("\n", "\r\n", "\r"):
            file.write_bytes(f"é{end}2{end}{end}3".encode(encoding))
            assert list(text_lines(file)) == ["é", "2", "", "3"]
    file.write_bytes(b"caf\xe9\n1")
    assert list(text_lines(file)) == ["caf\ufffd", "1"]


def test_numbers_become_a_table(tmp_path: Path) -> None:
    numbers = Numbers(tmp_path / "a.csv", 3)
    numbers.add((1, 2, 3))
    numbers.add((4, 1e300, float("nan")))
    assert len(numbers) == 2
    np.testing.assert_array_equal(numbers.table(), [[1, 2, 3], [4, np.inf, np.nan]])


def test_numbers_beyond_all_positions(tmp_path: Path) -> None:
    numbers = Numbers(tmp_path / "a.csv", 1)
    with pytest.raises(ClipError, match="holds no rows"):
        numbers.table()
    numbers.add((-1e30,))
    with pytest.raises(ClipError, match=r"a\.csv: holds numbers of 1e\+09 and more"):
        numbers.table()


def test_too_many_numbers_or_rows(tmp_path: Path) -> None:
    numbers = Numbers(tmp_path / "a.csv", 1, most_rows=2)
    for _ in range(3):
        numbers.add((1,))
    with pytest.raises(ClipError, match=r"a\.csv: holds more than .* 2 rows"):
        numbers.add((1,))
    with pytest.raises(ClipError, match=r"a\.csv: holds more than 16777216 numbers"):
        Numbers(tmp_path / "a.csv", 1).add(range(LARGEST_CLIP + 1))


def test_what_stands_for_a_missing_number() -> None:
    for text in ("", " ", "NA", "null", "-", "nan"):
        assert np.isnan(number(text))
    assert number(" 1.5e1 ") == 15
    with pytest.raises(ValueError, match="wave"):
        number("wave")
