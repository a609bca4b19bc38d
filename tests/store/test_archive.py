"""Export and import: nothing is lost on the way, and nothing else gets in."""

import hashlib
import json
import os
import random
import stat
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file
from storing import alter, make_clip, same

from actioncli.errors import StoreError, SupportError
from actioncli.store import archive
from actioncli.store.record import Record
from actioncli.store.store import SupportStore
from tests.forking import files_up_to
from tests.fuzz.readers import _pack_archive, _unpack_archive


@pytest.fixture
def exported(store: SupportStore, tmp_path: Path) -> Path:
    """An export of `store`, which holds four examples."""
    store.enroll("wave", make_clip(0, confidence=True), note="left hand")
    store.enroll("挥手 🤷", make_clip(1, frames=9, joints=2, source="/home/anna/a b.npy"))
    store.enroll("wave", make_clip(2))
    store.enroll("noise", make_clip(3), negative=True)
    path = tmp_path / "support.safetensors"
    assert store.export(path) == 4
    return path


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of an export of three examples; the first has a confidence."""
    folder = tmp_path_factory.mktemp("export")
    store = SupportStore(folder / "support.db")
    store.enroll_all(("wave", make_clip(seed, confidence=seed == 0)) for seed in range(3))
    store.export(folder / "support.safetensors")
    return (folder / "support.safetensors").read_bytes()


def header_of(content: bytes) -> dict[str, Any]:
    length = int.from_bytes(content[:8], "little")
    header: dict[str, Any] = json.loads(content[8 : 8 + length])
    return header


def with_header(content: bytes, header: object) -> bytes:
    length = int.from_bytes(content[:8], "little")
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + content[8 + length :]


def with_manifest(content: bytes, change: Callable[[list[Any]], object]) -> bytes:
    """The file that a forger would make: changed, with hashes and header that fit."""
    header = header_of(content)
    manifest = json.loads(header["__metadata__"]["examples"])
    changed = change(manifest)
    manifest = manifest if changed is None else changed
    text = json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))
    header["__metadata__"]["examples"] = text
    header["__metadata__"]["sha256"] = hashlib.sha256(
        text.encode("utf-8", "surrogatepass")
    ).hexdigest()
    return with_header(content, header)


def refused(path: Path, content: bytes, match: str | None = None) -> str:
    """Import refuses the content as a whole, leaves a store as it is and does not create one."""
    path.write_bytes(content)
    store, there = (SupportStore(path.parent / name / "support.db") for name in ("new", "there"))
    there.enroll("clap", make_clip(77))
    before = there.path.read_bytes()
    for each in (store, there):
        with pytest.raises(StoreError, match=match) as error:
            each.import_(path)
        assert str(path) in str(error.value)
    assert not store.path.parent.exists()
    assert there.path.read_bytes() == before
    return str(error.value)


def test_everything_arrives(store: SupportStore, exported: Path, tmp_path: Path) -> None:
    other = SupportStore(tmp_path / "other" / "support.db")
    assert other.import_(exported) == (4, 0)
    assert other.examples() == store.examples()
    for example in store.examples():
        assert same(other.clip(example.id), store.clip(example.id))
    assert len(other.negatives()) == 1
    assert other.check() == []
    assert other.import_(exported) == (0, 4)
    assert other.examples() == store.examples()
    again = tmp_path / "again.safetensors"
    other.export(again)
    assert again.read_bytes() == exported.read_bytes()


def test_other_programs_can_read_it(exported: Path) -> None:
    tensors = load_file(exported)
    np.testing.assert_array_equal(tensors["0/joints"], make_clip(0).joints)
    assert tensors["0/confidence"].shape == (6, 4)
    assert tensors["1/joints"].shape == (9, 2, 3)
    assert len(tensors) == 5


def test_the_export_is_private_and_tells_no_folder(exported: Path) -> None:
    assert stat.S_IMODE(exported.stat().st_mode) == 0o600
    content = exported.read_bytes()
    assert b"anna" not in content
    assert b"a b.npy" in content
    assert b"pickle" not in content


def test_a_clash_of_kinds_refuses_the_whole(exported: Path, tmp_path: Path) -> None:
    other = SupportStore(tmp_path / "other.db")
    other.enroll("noise", make_clip(5))
    with pytest.raises(StoreError, match="`noise` holds an action"):
        other.import_(exported)
    assert [action.label for action in other.actions()] == ["noise"]


def test_an_older_export_is_replaced_and_nothing_else_is(
    store: SupportStore, exported: Path, tmp_path: Path
) -> None:
    store.remove("noise")
    assert store.export(exported) == 3
    assert SupportStore(tmp_path / "other.db").import_(exported) == (3, 0)
    thesis = tmp_path / "thesis.txt"
    thesis.write_text("mine")
    for path in (thesis, store.path):
        before = path.read_bytes()
        with pytest.raises(StoreError, match="is no export"):
            store.export(path)
        assert path.read_bytes() == before
    link = tmp_path / "link"
    link.symlink_to(exported)
    with pytest.raises(StoreError, match="is no export"):
        store.export(link)
    with pytest.raises(StoreError, match="cannot be written"):
        store.export(tmp_path)
    with pytest.raises(StoreError, match="cannot be written"):
        store.export(tmp_path / "no folder" / "support.safetensors")
    assert not list(tmp_path.glob(".actioncli-*"))


def test_an_empty_store_exports_nothing(store: SupportStore, tmp_path: Path) -> None:
    with pytest.raises(SupportError):
        store.export(tmp_path / "support.safetensors")
    store.enroll("wave", make_clip(0))
    store.clear()
    with pytest.raises(SupportError):
        store.export(tmp_path / "support.safetensors")
    assert not (tmp_path / "support.safetensors").exists()


def test_damage_in_the_store_is_not_exported(store: SupportStore, exported: Path) -> None:
    before = exported.read_bytes()
    alter(store.path, "UPDATE examples SET fps = 26 WHERE id = 2")
    with pytest.raises(StoreError, match="example 2 of '挥手 🤷' is damaged"):
        store.export(exported)
    assert exported.read_bytes() == before
    assert not list(exported.parent.glob(".actioncli-*"))


def test_too_much_for_one_export_is_told(
    store: SupportStore, exported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "LARGEST_HEADER", 1000)
    with pytest.raises(StoreError, match="too many for one export"):
        store.export(exported)
    refused(exported, exported.read_bytes(), "larger than any export")


def test_a_full_disk_is_told(store: SupportStore, exported: Path, tmp_path: Path) -> None:
    with files_up_to(1000), pytest.raises(StoreError, match="Free some space"):
        store.export(tmp_path / "other")
    assert not list(tmp_path.glob(".actioncli-*"))


def test_what_is_no_file_is_told(store: SupportStore, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "missing", tmp_path, tmp_path / "pipe", Path("a\0b")):
        with pytest.raises(StoreError, match=r"no ordinary file|cannot be"):
            store.import_(path)
    assert not store.path.exists()


def test_a_truncated_file_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file"
    for size in [*range(0, 20), *range(20, len(content), 29), len(content) - 1]:
        refused(path, content[:size])
    refused(path, content + b"\0", "appended")


def test_a_file_that_changes_after_it_was_checked_is_refused_whole(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    read = archive.read_archive

    def then_damage(path: Path) -> Iterator[Record]:
        yield from read(path)
        path.write_bytes(content[:-1] + b"\x55")

    monkeypatch.setattr(archive, "read_archive", then_damage)
    other = SupportStore(tmp_path / "other.db")
    with pytest.raises(StoreError, match="example 3"):
        other.import_(path)
    assert other.examples() == []


def test_a_flipped_bit_is_refused_or_changes_nothing(content: bytes, tmp_path: Path) -> None:
    exported = tmp_path / "file"
    exported.write_bytes(content)
    generator = random.Random(0)
    whole = list(archive.read_archive(exported))
    told = 0
    for _ in range(400):
        damaged = bytearray(content)
        damaged[generator.randrange(len(content))] ^= 1 << generator.randrange(8)
        exported.write_bytes(damaged)
        try:
            assert list(archive.read_archive(exported)) == whole
        except StoreError:
            told += 1
    assert told > 390


def test_a_hostile_header_is_refused(content: bytes, tmp_path: Path) -> None:
    exported = tmp_path / "file"
    header = header_of(content)
    metadata = header["__metadata__"]
    for other in (
        b"", b"\0" * 8, b"\0" * 100, b"\xff" * 100, b"PK\x03\x04" * 50, b"\x80\x04\x95" * 50,
        b"\x93NUMPY\x01\0" + b"x" * 200,
    ):  # fmt: skip
        refused(exported, other)
    for text in (
        b"[" * 100_000,
        b"{" + b'"a":{' * 50_000,
        b"[]", b"null", b"3", b"{}", b'{"__metadata__":3}', b'"\\ud800"', b"\xff\xfe", b"{" * 10,
        b"1" * 10_000,
    ):  # fmt: skip
        refused(exported, len(text).to_bytes(8, "little") + text + b" " * 8)
    for changes in (
        {"format": "another"}, {"version": "2"}, {"version": "\x1b[31m" * 100}, {"version": 1},
        {"sha256": "0" * 64}, {"sha256": None}, {"examples": []}, {"examples": "\ud800"},
        {"surplus": "x"},
    ):  # fmt: skip
        message = refused(
            exported, with_header(content, header | {"__metadata__": metadata | changes})
        )
        assert message.isprintable()
    first = header["0/joints"]
    for tensor in (
        {**first, "dtype": "F64"},
        {**first, "dtype": "F16"},
        {**first, "shape": [2**62, 2**62, 3]},
        {**first, "shape": [4, 6, 3]},
        {**first, "data_offsets": [0, 2**63]},
        {**first, "data_offsets": [-288, 0]},
        {**first, "data_offsets": [288, 576]},
        None,
    ):
        refused(
            exported, with_header(content, header | {"0/joints": tensor}), "header does not fit"
        )
    refused(exported, with_header(content, header | {"9/joints": first}), "header does not fit")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("label", ""), ("label", "x" * 101), ("label", "a\nb"), ("label", "\x1b]0;evil\x07"),
        ("label", "\u202egnp"), ("label", " wave"), ("label", 3), ("label", None),
        ("label", "\ud800"), ("label", "cafe\u0301"),
        ("source", "/etc/passwd"), ("source", "../../.bashrc"), ("source", "C:\\evil"),
        ("source", "a\x1b[2Jb"), ("source", "x" * 256), ("source", None),
        ("note", "a\x07b"), ("note", "two\nlines"), ("note", "x" * 501), ("note", 3),
        ("added", "yesterday"), ("added", "2026-01-01"), ("added", "2026-01-01T00:00:00+00:00"),
        ("added", "2026-13-01T00:00:00Z"), ("added", "\x1b[31m"),
        ("fps", 30), ("fps", -1.0), ("fps", 0.0), ("fps", float("nan")), ("fps", float("inf")),
        ("fps", "30"), ("fps", 29.0),
        ("frames", 0), ("frames", 1), ("frames", -6), ("frames", 7), ("frames", 2**62),
        ("frames", True), ("frames", 6.0), ("frames", 10**400),
        ("joint_names", []), ("joint_names", ["a"]), ("joint_names", ["a", "a", "b", "c"]),
        ("joint_names", ["a", "b", "c", 4]), ("joint_names", ["a", "b", "c", "\x1b[2J"]),
        ("joint_names", ["a", "b", "c", ""]), ("joint_names", "abcd"),
        ("joint_names", [str(place) for place in range(100_000)]),
        ("negative", 1), ("negative", None), ("confidence", 0), ("confidence", False),
        ("checksum", "0" * 64), ("checksum", "../x"), ("checksum", None),
        ("surplus", 1),
    ],
)  # fmt: skip
def test_a_forged_manifest_is_refused(
    content: bytes, tmp_path: Path, field: str, value: object
) -> None:
    message = refused(
        tmp_path / "file", with_manifest(content, lambda lines: lines[0].update({field: value}))
    )
    assert message.isprintable()


def test_what_is_left_out_or_in_another_order_is_refused(content: bytes, tmp_path: Path) -> None:
    for change in (
        lambda lines: {},
        lambda lines: 3,
        lambda lines: [[]],
        lambda lines: lines[0].pop("note") and None,
        lambda lines: lines.pop() and None,
        lambda lines: lines.reverse(),
    ):
        refused(tmp_path / "file", with_manifest(content, change))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("fps", -1.0), ("fps", 0.0), ("fps", float("nan")), ("fps", float("inf")),
        ("joint_names", ["a", "a", "b", "c"]), ("joint_names", ["a", "b", "c", ""]),
        ("joint_names", ["a", "b", "c", "\x1b[2J"]), ("joint_names", ["a", "b", "c", "\ud800"]),
        ("joint_names", ["a", "b", "\x1b[2J", "\x1b[2J"]),
        # Joints that stay where they are, are lost, or are far away.
        ("joints", 1.0), ("joints", float("nan")), ("joints", 1e30),
    ],
)  # fmt: skip
def test_a_forged_checksum_does_not_help(
    content: bytes, tmp_path: Path, field: str, value: Any
) -> None:
    """Names, frames, joints that fit one another and their checksum, but are no clip."""
    manifest, tensors, settings = _unpack_archive(content)
    lines = json.loads(manifest)
    if field == "joints":
        joints = np.array([1] * 24 + [value] * 48, "<f4").tobytes()
        tensors = tensors[: -len(joints)] + joints
    else:
        lines[2][field] = value
    forged = _pack_archive([json.dumps(lines).encode(), tensors, settings])
    message = refused(tmp_path / "file", forged)
    assert "checksum differs" not in message
    assert message.isprintable()


def test_the_same_example_twice_is_added_once_and_nothing_adds_nothing(
    exported: Path, tmp_path: Path
) -> None:
    other = SupportStore(tmp_path / "other.db")
    archive.write_archive(exported, [], [])
    assert other.import_(exported) == (0, 0)
    assert not other.path.exists()
    record = Record.from_clip("wave", make_clip(0))
    outline = replace(record, joints=b"")
    archive.write_archive(exported, [outline] * 3, [record] * 3)
    assert other.import_(exported) == (1, 2)


def test_settings_travel_and_are_read_with_suspicion(
    store: SupportStore, content: bytes, tmp_path: Path
) -> None:
    store.enroll("wave", make_clip(0))
    store.set_setting("threshold", "0.25")
    file = tmp_path / "file"
    store.export(file)
    whole = file.read_bytes()
    assert header_of(whole)["__metadata__"]["version"] == "2"
    assert header_of(content)["__metadata__"]["version"] == "1"
    assert archive.carried_settings(file) == {"threshold": "0.25"}
    load_file(file)
    other = SupportStore(tmp_path / "other.db")
    other.import_(file)
    assert other.setting("threshold") == "0.25"
    metadata = header_of(whole)["__metadata__"]
    refused(file, whole.replace(b"0.25", b"0.75"), "settings are damaged")
    long = json.dumps({"a": "x" * (archive.LARGEST_SETTING + 1)})
    for settings in (
        "[]", "{}", '{"a": 1}', '{"a": "\\u001b[2J"}', '{"\\n": "x"}', "x", "[" * 9999, long,
    ):  # fmt: skip
        digest = hashlib.sha256(settings.encode()).hexdigest()
        forged = {**metadata, "settings": settings, "settings_sha256": digest}
        refused(file, with_header(whole, header_of(whole) | {"__metadata__": forged}))
    # Settings that an older release would pass over are not hidden in its version.
    hidden = {**metadata, "version": "1"}
    refused(file, with_header(whole, header_of(whole) | {"__metadata__": hidden}))
