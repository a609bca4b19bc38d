"""What a file holds, before anything is decided about it."""

from __future__ import annotations

from dataclasses import dataclass

from actioncli.clips.clip import FloatArray

# The most coordinates and frames a clip may have: 30 joints at 30 fps for 1.7 hours, and 2.4
# hours. An action takes seconds; what is larger is a wrong file or a hostile one, and all that
# reading does with so much stays far below a gigabyte.
LARGEST_CLIP = 2**24
LONGEST_CLIP = 2**18
MOST_JOINTS = 2**10
MOST_PEOPLE = 64


@dataclass(frozen=True, slots=True)
class Recording:
    """Joint positions as a file states them, in its own unit and axes.

    Attributes:
        positions: (T, P, J, 3) float32 of P people; NaN where a coordinate is missing.
        joint_names: J names, or None where the file has none.
        layout: name of a layout, where the file states one.
        fps: frames per second, where the file states them.
        unit: unit of length, where the file or its format states one.
        up: the axis that points up, signed, where the file or its format states one.
        rest_up: the up axis that the file's rest pose suggests; only evidence.
        confidence: (T, P, J) float32 in [0, 1], or None.
        people: P names for people to read; empty where the file only counts them.
        zeros_are_gaps: whether a joint at exactly (0, 0, 0) means that it was not seen.
        notes: what the reader decided.
    """

    positions: FloatArray
    joint_names: tuple[str, ...] | None = None
    layout: str | None = None
    fps: float | None = None
    unit: str | None = None
    up: str | None = None
    rest_up: str | None = None
    confidence: FloatArray | None = None
    people: tuple[str, ...] = ()
    zeros_are_gaps: bool = True
    notes: tuple[str, ...] = ()
