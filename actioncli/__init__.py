"""Record one clip of an action; recognise it in new clips; reject everything else.

The names below are imported when they are first used, so that `import actioncli` costs next to
nothing and a command that needs no numpy does not load it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from actioncli._version import __version__
from actioncli.errors import (
    ActionCliError,
    AmbiguousClipError,
    ClipError,
    StoreError,
    SupportError,
    UsageError,
    WeightsError,
)

if TYPE_CHECKING:
    from actioncli.actions import Actions, open
    from actioncli.calibration.enrolment import enrol
    from actioncli.clips.clip import Clip
    from actioncli.clips.collection import Collection, read_collection
    from actioncli.live.events import Event
    from actioncli.live.watching import watch
    from actioncli.pose.read import read_clip, read_video_clip
    from actioncli.recognition.decision import Comparison, Decision
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.recognition.support import SupportSet
    from actioncli.store.store import SupportStore

__all__ = [
    "ActionCliError",
    "Actions",
    "AmbiguousClipError",
    "Clip",
    "ClipError",
    "Collection",
    "Comparison",
    "Decision",
    "Event",
    "Recognizer",
    "StoreError",
    "SupportError",
    "SupportSet",
    "SupportStore",
    "UsageError",
    "WeightsError",
    "__version__",
    "enrol",
    "open",
    "read_clip",
    "read_collection",
    "read_video_clip",
    "watch",
]

_MODULE_OF = {
    "Actions": "actioncli.actions",
    "open": "actioncli.actions",
    "Clip": "actioncli.clips.clip",
    "Collection": "actioncli.clips.collection",
    "read_collection": "actioncli.clips.collection",
    "read_clip": "actioncli.pose.read",
    "read_video_clip": "actioncli.pose.read",
    "Comparison": "actioncli.recognition.decision",
    "Decision": "actioncli.recognition.decision",
    "Recognizer": "actioncli.recognition.recognizer",
    "SupportSet": "actioncli.recognition.support",
    "SupportStore": "actioncli.store.store",
    "Event": "actioncli.live.events",
    "enrol": "actioncli.calibration.enrolment",
    "watch": "actioncli.live.watching",
}


def __getattr__(name: str) -> object:
    """Import a public name at its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
