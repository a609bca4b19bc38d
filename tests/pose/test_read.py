from pathlib import Path

import pytest

from actioncli.errors import ClipError, UsageError
from actioncli.pose import ReadOptions
from actioncli.pose.read import is_video, read_any

EXAMPLE = Path(__file__).parents[2] / "examples" / "squat" / "ada.npz"


def test_kinds() -> None:
    assert is_video("a/B.MP4")
    assert is_video(Path("a.webm"))
    assert not is_video(EXAMPLE)


def test_joints_are_read_whatever_the_video_options_say() -> None:
    clip = read_any(EXAMPLE, ReadOptions(quality="accurate", cache=False))
    assert len(clip) > 10


@pytest.mark.parametrize(
    ("path", "options"),
    [(EXAMPLE, {"start": 1.0}), (EXAMPLE, {"person": 2}), ("a.mp4", {"fps": 9})],
)
def test_options_without_meaning(path: Path, options: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="means nothing for"):
        read_any(path, ReadOptions(**options))


def test_a_video_that_is_not_there() -> None:
    with pytest.raises(ClipError, match="No such file"):
        read_any("none.mp4")


def test_what_is_neither_is_told_with_both_kinds(tmp_path: Path) -> None:
    with pytest.raises(ClipError, match=r"is a folder and holds none; clips .*\.npy.*\.mp4"):
        read_any(tmp_path)
    picture = tmp_path / "a.png"
    picture.touch()
    with pytest.raises(ClipError, match=r"a name of neither kind; clips .*\.npy.*\.mp4"):
        read_any(picture)
    with pytest.raises(ClipError, match=r"b\.png: no such file"):
        read_any(tmp_path / "b.png")


def test_an_address_is_no_file() -> None:
    """Of `https://`, a path keeps one slash."""
    for address in ("https://example.org/v.mp4", Path("https://example.org/v.mp4")):
        with pytest.raises(ClipError, match="https://example"):
            read_any(address)
