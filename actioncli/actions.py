"""The user's actions from Python, in as few words as on the command line: `actioncli.open()`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.calibration.enrolment import Enrolled, enrol
from actioncli.clips.active import one_repetition
from actioncli.clips.clip import Clip
from actioncli.clips.read import CLIP_SUFFIXES
from actioncli.files import data_frame
from actioncli.pose.read import read_clip
from actioncli.recognition.decision import Decision
from actioncli.recognition.followed import FollowedSupport
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.store.store import SupportStore

if TYPE_CHECKING:
    from actioncli.live.events import Event
    from actioncli.live.recorder import Kept
    from actioncli.recognition.explanation import Explanation


def open(store: str | Path | None = None, weights: str | Path | None = None) -> Actions:
    """The support set that the commands use, to enrol into and to ask.

    Args:
        store: its file; the user's own where None. Nothing is created before the first clip.
        weights: those that came with the package where None.

    Raises:
        StoreError: it cannot be a support set.
        WeightsError: the weights cannot be read.
    """
    return Actions(SupportStore(store), Recognizer(weights))


class Actions:
    """A support set on disk with all that is done with it. What other processes and threads
    enrol meanwhile is heeded, as are negatives and the threshold that `calibrate` kept.

    Wherever a clip is taken, it is a `Clip`, or a file of joints or a video.

    Attributes:
        store: where examples are kept.
        recognizer: what compares.
    """

    def __init__(self, store: SupportStore, recognizer: Recognizer) -> None:
        self.store, self.recognizer = store, recognizer
        self._followed = FollowedSupport(store, recognizer)

    def __repr__(self) -> str:
        return f"Actions({', '.join(self.support.actions) or 'none yet'}; {self.store.path})"

    @property
    def version(self) -> str:
        """Changes when the store does, whoever changes it."""
        return self._followed.version()

    @property
    def support(self) -> SupportSet:
        """What is enrolled now.

        Raises:
            StoreError: the store cannot be read.
        """
        return self._followed()

    def enrol(
        self,
        label: str,
        *clips: str | Path | Clip,
        note: str = "",
        negative: bool = False,
        either_side: bool = False,
        keep_tau: bool = False,
    ) -> list[Enrolled]:
        """Keep clips as examples of an action, all of them or none; see `enrolment.enrol`.

        Raises:
            UsageError: the label is not allowed.
            ClipError: a clip cannot be read, or shows no action.
            StoreError: the store cannot be written.
        """
        read = [_clip(clip) for clip in clips]
        options = note, negative, either_side, keep_tau
        return enrol(self.store, self.recognizer, label, read, *options)

    def classify(self, clip: str | Path | Clip, tau: float | None = None) -> Decision:
        """Name the action that a clip shows, or reject it.

        Args:
            tau: accept where the confidence is above it, instead of the threshold that counts.

        Raises:
            ClipError: the clip cannot be read.
            SupportError: no action is enrolled.
        """
        return self._asked(tau).classify(_clip(clip))

    def explain(self, clip: str | Path | Clip) -> Explanation:
        """What speaks for the nearest action and what against it; see `Explanation`.

        Raises:
            ClipError, SupportError: as `classify`.
        """
        from actioncli.recognition.explanation import explain_decision

        read = _clip(clip)
        return explain_decision(self.recognizer, self.store, read, self.classify(read))[0]

    def watch(
        self, source: int | str | Path | Clip = 0, tau: float | None = None, **options: Any
    ) -> Iterator[Event]:
        """Tell every enrolled action that somebody performs, one after another.

        Args:
            source: a camera's number, an address, or a clip, as if it came frame by frame.
            tau: as in `classify`.
            options: those of `actioncli.watch`.

        Raises:
            ClipError: the source cannot be opened, or is lost; after the last event.
            SupportError: no action is enrolled.
        """
        from actioncli.live.watching import watch

        if isinstance(source, str | Path) and Path(source).suffix.lower() in CLIP_SUFFIXES:
            source = read_clip(source)
        # What is enrolled meanwhile counts, too.
        return watch(source, lambda: self.support, tau, **options)

    def to_pandas(self) -> Any:
        """A DataFrame of the examples, by number: label, source, seconds, and so on.

        Raises:
            UsageError: pandas is not installed.
        """
        columns = ["id", "label", "negative", "source", "frames", "fps", "seconds", "added", "note"]
        rows = [{name: getattr(each, name) for name in columns} for each in self.store.examples()]
        return data_frame(rows, columns=columns).set_index("id")

    def _asked(self, tau: float | None) -> SupportSet:
        return self.support if tau is None else self.support.with_tau(tau)


def decide_on(actions: Actions, kept: Kept, decision: str, label: str = "") -> list[str]:
    """Enrol a clip that `watch --record` kept (`enroll`), make it a negative (`negative`) or delete
    it (`delete`): either way it leaves the folder. What is to be said of it.

    Raises:
        ClipError, UsageError, StoreError: as `Actions.enrol`; the clip stays.
    """
    told: list[str] = []
    if decision != "delete":
        one, negative = one_repetition(kept.clip()), decision == "negative"
        (enrolled,) = actions.enrol(label, one, note=kept.origin, negative=negative)
        told = [*one.notes, *enrolled.told]
    kept.forget()
    return told


def _clip(clip: str | Path | Clip) -> Clip:
    return clip if isinstance(clip, Clip) else read_clip(clip)
