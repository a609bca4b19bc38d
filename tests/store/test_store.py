"""The support set: enrolling, listing, removing, renaming."""

import contextlib
import re
from datetime import UTC, datetime
from pathlib import Path

import pytest
from storing import alter, make_clip, same

from actioncli.errors import ClipError, StoreError, SupportError, UsageError
from actioncli.store.store import Action, Inserted, SupportStore


def test_a_clip_comes_back_bit_for_bit(store: SupportStore) -> None:
    for seed, confidence in ((0, False), (1, True)):
        clip = make_clip(seed, confidence=confidence, source="/home/anna/wave.npy")
        enrolled = store.enroll("  wave ", clip, note="left\nhand")
        assert enrolled == Inserted(seed + 1, "wave", added=True)
        assert store.enroll("wave", clip, note="again") == Inserted(seed + 1, "wave", added=False)
        again = store.clip(enrolled.example)
        assert same(again, clip)
        assert again.source == "wave.npy"
    example = store.examples()[0]
    assert (example.label, example.negative, example.source) == ("wave", False, "wave.npy")
    assert (example.frames, example.joints, example.fps) == (6, 4, 25.0)
    assert example.note == "left hand"
    assert re.fullmatch("[0-9a-f]{64}", example.checksum)
    added = datetime.strptime(example.added, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=UTC)
    assert abs((datetime.now(UTC) - added).total_seconds()) < 60
    assert store.check() == []


def test_many_are_enrolled_together_or_not_at_all(store: SupportStore) -> None:
    assert store.enroll_all([]) == []
    assert not store.path.exists()
    with pytest.raises(UsageError):
        store.enroll_all([("wave", make_clip(0)), ("", make_clip(1))])
    with pytest.raises(ClipError):
        store.enroll_all([("wave", make_clip(0)), ("wave", make_clip(1, 2, 1001))])
    assert store.actions() == []
    store.enroll("noise", make_clip(2), negative=True)
    with pytest.raises(UsageError, match="`noise` holds negatives"):
        store.enroll_all([("wave", make_clip(0)), ("noise", make_clip(1))])
    assert same(store.negatives()[0], make_clip(2))
    assert [action.label for action in store.actions()] == ["noise"]


def test_actions_are_listed_by_name(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0, frames=26))
    store.enroll("clap", make_clip(1, frames=11))
    store.enroll("wave", make_clip(2, frames=51))
    store.enroll("noise", make_clip(3, frames=26), negative=True)
    last = store.examples()[0].added
    assert [
        (action.label, action.examples, pytest.approx(action.seconds), action.negative)
        for action in store.actions()
    ] == [("clap", 1, 0.4, False), ("noise", 1, 1.0, True), ("wave", 2, 3.0, False)]
    assert isinstance(store.actions()[0], Action)
    assert store.actions()[0].last_added >= last
    assert [(example.id, example.label) for example in store.examples()] == [
        (2, "clap"), (4, "noise"), (1, "wave"), (3, "wave"),
    ]  # fmt: skip
    assert [example.id for example in store.examples("wave")] == [1, 3]


def test_removing(store: SupportStore) -> None:
    for seed in range(3):
        store.enroll("wave", make_clip(seed))
    store.enroll("clap", make_clip(3))
    assert store.remove("wave", 2) == 1
    assert [example.id for example in store.examples("wave")] == [1, 3]
    for example in (2, 4, 99, -1, 2**70):
        with pytest.raises(SupportError, match="has no example"):
            store.remove("wave", example)
        if example != 4:
            with pytest.raises(SupportError, match="There is no example"):
                store.clip(example)
    assert store.remove(" wave ") == 2
    assert [action.label for action in store.actions()] == ["clap"]
    assert store.clear() == 1
    assert store.clear() == 0
    assert store.actions() == []
    content = store.path.read_bytes()
    assert b"clip.npy" not in content  # what was removed is gone from the file


def test_an_unknown_label_is_told_with_those_there_are(store: SupportStore) -> None:
    def asks() -> list[object]:
        return [
            lambda: store.examples("wvae"),
            lambda: store.remove("wvae"),
            lambda: store.rename("wvae", "clap"),
        ]

    for ask in asks():
        with pytest.raises(SupportError, match="nothing is") as error:
            ask()
        assert error.value.exit_code == 4
    assert not store.path.parent.exists()
    store.enroll("wave", make_clip(0))
    for ask in asks():
        with pytest.raises(SupportError, match="`wvae` is not enrolled; enrolled: `wave`"):
            ask()
    for new, why in (("a\nb", "not printable"), ("clap", "is enrolled already")):
        store.enroll("clap", make_clip(1))
        with pytest.raises(UsageError, match=why):
            store.rename("wave", new)
    assert store.rename("wave", " greet ") == store.rename("greet", "wave") == 1
    store.enroll_all((f"action {seed:02}", make_clip(seed)) for seed in range(12))
    with pytest.raises(SupportError, match=r"`action 09`, \.\.\.\.$"):
        store.examples("wvae")


def test_a_store_that_is_not_there_is_empty_and_stays_away(store: SupportStore) -> None:
    assert store.actions() == []
    assert store.examples() == []
    assert store.support() == {}
    assert store.negatives() == []
    assert store.setting("tau") is None
    assert store.clear() == 0
    assert store.check() == []
    with pytest.raises(SupportError):
        store.clip(1)
    assert not store.path.parent.exists()


def test_settings_are_kept(store: SupportStore) -> None:
    store.set_setting("tau", None)
    assert not store.path.exists()  # forgetting creates nothing
    store.enroll("wave", make_clip(0))
    for value in ("0.6", "0.7", None, "0.5"):
        store.set_setting("tau", value)
        assert SupportStore(store.path).setting("tau") == value
    assert (store.clear(), store.setting("tau")) == (1, "0.5")
    assert (store.clear(settings=True), store.setting("tau")) == (0, None)
    assert store.check() == []


def test_it_can_be_used_in_a_with_block(store: SupportStore) -> None:
    with store as same_store:
        same_store.enroll("wave", make_clip(0))
    assert len(store.actions()) == 1
    assert repr(store) == f"SupportStore({str(store.path)!r})"


def test_damage_of_one_example_names_it_and_it_can_be_removed(store: SupportStore) -> None:
    store.enroll_all((label, make_clip(seed)) for seed, label in enumerate(["wave", "clap"]))
    alter(store.path, "UPDATE examples SET joints = zeroblob(length(joints)) WHERE id = 1")
    assert store.check()[0].startswith(f"{store.path}: example 1 of 'wave' is damaged")
    for ask in (store.support, lambda: store.clip(1)):
        with pytest.raises(StoreError, match="doctor --repair"):
            ask()
    assert len(store.actions()) == 2
    store.remove("wave", 1)
    assert store.check() == []


@pytest.mark.parametrize(
    "change",
    ["joint_names = '['", "joint_names = '{}'", "joint_names = '[3]'",
     "label = CAST(label AS BLOB)", "source = CAST(source AS BLOB)", "fps = 'fast'",
     "frames = 'many'", "checksum = x'00'",
     "joints = CAST(joints AS TEXT)", "added = CAST(x'ff' AS TEXT)", "label = CAST(x'ff' AS TEXT)"],
)  # fmt: skip
def test_columns_of_another_kind_are_damage(
    store: SupportStore, tmp_path: Path, change: str
) -> None:
    store.enroll("wave", make_clip(0))
    alter(store.path, "PRAGMA ignore_check_constraints = ON", f"UPDATE examples SET {change}")
    assert store.check()
    for ask in (store.support, lambda: store.clip(1), lambda: store.export(tmp_path / "out")):
        with pytest.raises(StoreError, match="damaged"):
            ask()
    for ask in (store.actions, store.examples):
        with contextlib.suppress(StoreError):
            ask()  # what it needs may be whole
    assert not (tmp_path / "out").exists()
    store.clear()
    assert store.check() == []
