"""An example as it is kept: the clip's content as bytes, with its checksum and what people said.

Joints are little-endian float32, whatever the machine, so that stores and exports can travel.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from actioncli.errors import ClipError
from actioncli.store.names import check_label, file_name, plain_text

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip

TIME_FORMAT = "%Y-%m-%dT%H:%M:%SZ"
MOST_JOINTS = 1000
# An hour and a half of 33 joints at 30 fps: beyond any action, and small enough to hold.
LARGEST_CLIP_BYTES = 64 * 2**20
LONGEST_JOINT_NAME = 100
# Characters of all names as JSON, where each may be an escape of twelve.
_LONGEST_NAMES = MOST_JOINTS * (12 * LONGEST_JOINT_NAME + 4)


@dataclass(frozen=True, slots=True)
class Record:
    """One example.

    Attributes:
        joints: frames * joints * 3 float32, little-endian, in C order.
        confidence: frames * joints float32, likewise, or None.
        checksum: SHA-256 (hex) of the content: names, fps, joints, confidence.
    """

    label: str
    negative: bool
    source: str
    note: str
    added: str
    fps: float
    frames: int
    joint_names: tuple[str, ...]
    checksum: str
    joints: bytes
    confidence: bytes | None

    @classmethod
    def from_clip(cls, label: str, clip: Clip, note: str = "", negative: bool = False) -> Record:
        """A clip as it will be kept, added now.

        Raises:
            UsageError: the label is not allowed.
            ClipError: the clip is too large to keep, or its joint names are not printable.
        """
        label = check_label(label)
        check_outline(len(clip.joints), clip.joint_names, clip.source)
        joints = clip.joints.astype("<f4").tobytes()
        confidence = None if clip.confidence is None else clip.confidence.astype("<f4").tobytes()
        checksum = _content_checksum(clip.fps, clip.joint_names, joints, confidence)
        added = datetime.now(UTC).strftime(TIME_FORMAT)
        return cls(
            label, negative, file_name(clip.source), plain_text(note), added, clip.fps,
            len(clip.joints), clip.joint_names, checksum, joints, confidence,
        )  # fmt: skip

    @classmethod
    def from_row(cls, row: Sequence[Any]) -> Record:
        """A row of the columns `COLUMNS`.

        Raises:
            ValueError, TypeError: the row is damaged.
        """
        label, negative, source, note, added, fps, frames, names, *content = row
        if len(names) > _LONGEST_NAMES:
            raise ValueError("joint names are too long")
        try:
            named = tuple(json.loads(names))
        except RecursionError as error:
            raise ValueError("joint names are nested") from error
        record = cls(
            label, bool(negative), source, note, added, float(fps), frames, named, *content
        )
        record.check_types()
        return record

    def check_types(self) -> None:
        """Look at what came from a file; the bytes are for `intact`.

        Raises:
            TypeError: a value is of another type than it should, or there is no movement.
        """
        texts = (self.label, self.source, self.note, self.added, self.checksum, *self.joint_names)
        others = {bool: self.negative, float: self.fps, int: self.frames}
        if (
            not all(isinstance(text, str) for text in texts)
            or any(type(value) is not kind for kind, value in others.items())
            or self.frames < 2
            or not self.joint_names
        ):
            raise TypeError("a value is of another type than it should")

    def row(self) -> tuple[Any, ...]:
        """The values of the columns `COLUMNS`."""
        return (
            self.label, int(self.negative), self.source, self.note, self.added, self.fps,
            self.frames, json.dumps(self.joint_names, ensure_ascii=False), self.checksum,
            self.joints, self.confidence,
        )  # fmt: skip

    def intact(self) -> bool:
        """Whether the content is what it was when the clip was enrolled."""
        return (
            isinstance(self.joints, bytes)
            and len(self.joints) == self.frames * len(self.joint_names) * 12
            and _content_checksum(self.fps, self.joint_names, self.joints, self.confidence)
            == self.checksum
        )

    def seal(self, example: int) -> int:
        """The seal of this record under the identifier `example`."""
        return seal(
            example, self.label, self.negative, self.source, self.note, self.added, self.checksum
        )

    def clip(self) -> Clip:
        """The clip.

        Raises:
            ClipError: the content is no valid clip.
            ValueError: the sizes do not fit one another.
        """
        import numpy as np

        from actioncli.clips.clip import Clip

        shape = (self.frames, len(self.joint_names))
        confidence = None
        if self.confidence is not None:
            confidence = np.frombuffer(self.confidence, "<f4").reshape(shape)
        joints = np.frombuffer(self.joints, "<f4").reshape(*shape, 3)
        return Clip(joints, self.joint_names, self.fps, confidence, self.source)


# The columns of the table `examples` that make a record.
COLUMNS = ", ".join(field.name for field in fields(Record))
# The same without the bytes of the recording.
_NO_BYTES = {"joints": "x''", "confidence": "substr(confidence, 1, 0)"}
OUTLINE = ", ".join(_NO_BYTES.get(field.name, field.name) for field in fields(Record))


def seal(
    example: int, label: str, negative: bool, source: str, note: str, added: str, checksum: str
) -> int:
    """CRC-32 of what an example has beside its content, which has its own checksum: between them
    a bit that flipped is noticed. Values that are no text, as damage makes them, are taken too."""
    sealed = [example, label, int(negative), source, note, added, checksum]
    return zlib.crc32(json.dumps(sealed, default=repr).encode())


def check_outline(frames: int, names: Sequence[str], source: str) -> None:
    """Refuse what is no clip of an action, or could not be shown.

    Raises:
        ClipError: too many frames or joints, or joint names that are not printable.
    """
    what = file_name(source) or "clip"
    if len(names) > MOST_JOINTS or frames * len(names) * 12 > LARGEST_CLIP_BYTES:
        raise ClipError(
            f"{what}: {frames} frames of {len(names)} joints are too much for an example (at most "
            f"{MOST_JOINTS} joints and {LARGEST_CLIP_BYTES >> 20} MB); cut the action out of the "
            "recording."
        )
    for name in names:
        if not (0 < len(name) <= LONGEST_JOINT_NAME and name.isprintable()):
            raise ClipError(
                f"{what}: the joint name {name[:LONGEST_JOINT_NAME]!a} is empty, too long or not "
                "printable; rename the joint."
            )


def find_flaw(record: Record) -> str | None:
    """Why a record is not what enrolling the same clip would have stored; None where it is.

    Raises:
        ActionCliError: its label is not allowed, or its content is no valid clip.
    """
    check_outline(record.frames, record.joint_names, "")
    if not record.intact():
        return "its content is damaged (the checksum differs)."
    # Equal to what the store itself makes of it: label, source and note are clean, names
    # printable, the clip valid.
    again = Record.from_clip(record.label, record.clip(), record.note, record.negative)
    if replace(again, added=record.added) != record:
        return "its label, note or source is not as the store would write it."
    try:
        time = datetime.fromisoformat(record.added).strftime(TIME_FORMAT)
    except ValueError:
        time = ""
    return None if time == record.added else "its time is not as the store would write it."


def _content_checksum(
    fps: float, names: tuple[str, ...], joints: bytes, confidence: bytes | None
) -> str:
    head = json.dumps([fps, names, confidence is not None], separators=(",", ":"))
    digest = hashlib.sha256(head.encode())
    digest.update(joints)
    digest.update(confidence or b"")
    return digest.hexdigest()
