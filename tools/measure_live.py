"""Measure `watch` on long recordings of other people's lives: what it tells, and what it makes up.

    python tools/measure_live.py --exercises exercise_videos.npz --everyday human36m.npz \\
        --people g3d.npz gtu.npz --splits tools/splits.json --weights bench.safetensors

Three kinds of streams, made of recordings of classes that `--splits` keeps from training, joined by
half a second in which one posture passes into the next:

- exercises: whole videos. Four are enrolled by one repetition each; the rest of these four, in
  which the same person goes on, stands among videos of other exercises.
- people: one person's clips of a collection. Four actions are enrolled by one clip each.
- everyday: a minute each of long recordings; what the first two enrolled is never done.

An event is right if at least half of it lies in a performance of its action. Prints a Markdown
table over the threshold: false events an hour, performances told, of sets the repetitions told
(those beyond the true number count as false) and how many are counted within one, and how long
after its end a performance is told (median). How often something is repeated is the length of the
set over that of the enrolled repetition, rounded.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actioncli.clips.active import action_in, active_part
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.collection import Collection, read_collection
from actioncli.clips.edit import cut, resample
from actioncli.clips.skeleton import DEFAULT_JOINTS, centred, select_joints
from actioncli.errors import ClipError
from actioncli.evaluation.splits import Splits, read_splits
from actioncli.live.events import STRIDE, Event, EventDetector
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet

FPS, PASSAGE, ENROLLED = 15.0, 0.5, 4
TAUS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
# Words of labels that do not tell exercises apart, and words for one motion.
_SAID = {"left", "right", "one", "with", "the", "and", "of", "arm", "leg", "arms", "clean"}
_JUMPS = {"jack", "jacks", "star", "jumps"}


@dataclass(frozen=True)
class Performance:
    """What is done in a stream, seconds, and how often."""

    label: str
    start: float
    end: float
    repetitions: int


@dataclass(frozen=True)
class Recorded:
    """A stream, what is enrolled, and what is done."""

    kind: str
    clip: Clip
    support: dict[str, Clip]
    truth: tuple[Performance, ...]


def joints_of(clip: Clip) -> FloatArray:
    """The default joints at the streams' rate, from where the pelvis is at first."""
    joints = select_joints(clip.filled(), clip.joint_names, DEFAULT_JOINTS, clip.source)
    wanted = np.arange(0, clip.duration, 1 / FPS)
    moved = resample(joints, np.arange(len(clip)) / clip.fps, wanted)
    origin = moved[:1] - centred(moved[:1], DEFAULT_JOINTS)
    return np.asarray(moved - origin[:, :1], np.float32)


def joined(
    kind: str,
    parts: Sequence[tuple[FloatArray, str | None, int]],
    support: dict[str, Clip],
) -> Recorded:
    """One stream of joints (frames, J, 3) with label and repetitions."""
    pieces, truth, frames = [], [], 0
    share = np.linspace(0, 1, round(PASSAGE * FPS) + 2)[1:-1, None, None]
    for joints, label, repetitions in parts:
        if pieces:
            pieces.append(pieces[-1][-1] * (1 - share) + joints[0] * share)
            frames += len(share)
        if label is not None:
            end = (frames + len(joints)) / FPS
            truth.append(Performance(label, frames / FPS, end, repetitions))
        pieces.append(joints)
        frames += len(joints)
    return Recorded(kind, Clip(np.concatenate(pieces), DEFAULT_JOINTS, FPS), support, tuple(truth))


def whole(path: Path) -> Collection:
    """A collection's recordings as they are, not the parts in which the action is done once."""
    with np.load(path, allow_pickle=False) as arrays, tempfile.TemporaryDirectory() as folder:
        kept = {name: arrays[name] for name in arrays if name not in ("active", "repetitions")}
        np.savez(Path(folder) / path.name, **kept)
        return read_collection(Path(folder) / path.name)


def _words(label: str) -> set[str]:
    words = set(re.findall(r"[a-z]+", label.lower())) - _SAID
    return words | _JUMPS if words & _JUMPS else words


def exercises(
    collection: Collection, splits: Splits, streams: int, rng: np.random.Generator
) -> Iterator[Recorded]:
    """Streams of about six minutes."""
    kept = set(splits.names(collection.name, "excluded", collection.labels))
    rows = [row for row, label in enumerate(collection.labels) if label in kept]
    sets = {}
    for row in rows:
        clip = collection.clips[row]
        start, end, repetitions = action_in(clip)
        if repetitions < 4:
            continue
        begin, over = active_part(clip)
        rest = (begin, start) if start - begin > over - end else (end, over)
        if (count := round((rest[1] - rest[0]) / (end - start))) >= 2:
            sets[row] = (start, end), rest, count
    for _ in range(streams):
        used: set[str] = set()
        chosen: list[int] = []
        for row in rng.permutation([*sets]).tolist():
            if len(chosen) < ENROLLED and not _words(collection.labels[row]) & used:
                used |= _words(collection.labels[row])
                chosen.append(row)
        support, parts = {}, []
        for row in chosen:
            one, rest, count = sets[row]
            clip, label = collection.clips[row], collection.labels[row]
            support[label] = Clip(joints_of(cut(clip, *one)), DEFAULT_JOINTS, FPS)
            parts.append((joints_of(cut(clip, *rest)), label, count))
        for row in rng.permutation(rows).tolist():
            if sum(len(part[0]) for part in parts) > 360 * FPS:
                break
            if not _words(collection.labels[row]) & used:
                parts.append((joints_of(collection.clips[row]), None, 1))
        yield joined("exercises", [parts[at] for at in rng.permutation(len(parts))], support)


def people(
    collection: Collection, splits: Splits, streams: int, rng: np.random.Generator
) -> Iterator[Recorded]:
    """Streams of up to sixty clips of one person."""
    kept = {label for part in ("excluded", "benchmark")
            for label in splits.names(collection.name, part, collection.labels)}  # fmt: skip
    for person in rng.permutation(sorted(set(collection.subjects)))[:streams].tolist():
        of: dict[str, list[int]] = {}
        for row in rng.permutation(len(collection)).tolist():
            if collection.subjects[row] == person and collection.labels[row] in kept:
                of.setdefault(collection.labels[row], []).append(row)
        chosen = [label for label, rows in of.items() if len(rows) > 1][:ENROLLED]
        support, parts = {}, []
        for label in chosen:
            first, *others = of[label]
            support[label] = Clip(joints_of(collection.clips[first]), DEFAULT_JOINTS, FPS)
            parts += [(joints_of(collection.clips[row]), label, 1) for row in others[:5]]
        others = [row for label, rows in of.items() if label not in chosen for row in rows]
        parts += [(joints_of(collection.clips[row]), None, 1) for row in others[: 60 - len(parts)]]
        yield joined("people", [parts[at] for at in rng.permutation(len(parts))], support)


def everyday(
    collection: Collection, supports: Sequence[dict[str, Clip]], rng: np.random.Generator
) -> Iterator[Recorded]:
    """For each support set a stream of ten minutes."""
    for support in supports:
        parts: list[tuple[FloatArray, str | None, int]] = []
        for row in rng.permutation(len(collection))[:10].tolist():
            clip = collection.clips[row]
            start = rng.uniform(0, max(clip.duration - 60, 0))
            parts.append((joints_of(cut(clip, start, min(start + 60, clip.duration))), None, 1))
        yield joined("everyday", parts, support)


# What each look says of each window and action, the last seconds, and when.
Looks = list[tuple[FloatArray, Clip | None, float]]


def looks_at(stream: Recorded, support: SupportSet) -> Looks:
    """All looks at a stream."""
    detector, looks = EventDetector(support), []
    keep = max(detector.windows) + 1
    for now in np.arange(STRIDE, stream.clip.duration, STRIDE).tolist():
        try:
            seen = cut(stream.clip, max(now - keep, 0.0), now)
        except ClipError:  # nothing has moved
            continue
        looks.append((detector.look(seen), seen, now))
    return looks


def told(looks: Looks, support: SupportSet) -> list[tuple[Event, float]]:
    """Events, and when each is told."""
    detector, found = EventDetector(support), []
    now = 0.0
    for odds, clip, now in looks:
        found += [(event, now) for event in detector.take(odds, clip, now)]
    return found + [(event, now) for event in detector.finish()]


@dataclass
class Score:
    """Sums over streams of one kind."""

    hours: float = 0.0
    false: int = 0
    performances: int = 0
    told: int = 0
    repetitions: int = 0
    counted: int = 0
    sets: int = 0
    close: int = 0
    delays: tuple[float, ...] = ()

    def add(
        self,
        seconds: float,
        truth: Sequence[Performance],
        events: Sequence[tuple[Event, float]],
    ) -> None:
        """Compare the events of a stream with what was done."""
        hits: list[list[float]] = [[] for _ in truth]
        self.hours += seconds / 3600
        for event, when in events:
            for done, hit in zip(truth, hits, strict=True):
                inside = min(event.end, done.end) - max(event.start, done.start)
                if event.label == done.label and inside >= (event.end - event.start) / 2:
                    hit.append(when)
                    break
            else:
                self.false += 1
        for done, hit in zip(truth, hits, strict=True):
            self.performances += 1
            self.told += bool(hit)
            self.repetitions += done.repetitions
            self.counted += min(len(hit), done.repetitions)
            self.false += max(len(hit) - done.repetitions - 1, 0)
            if done.repetitions > 1:
                self.sets += 1
                self.close += abs(len(hit) - done.repetitions) <= 1
            if hit:
                self.delays += (max(hit) - done.end,)

    def cells(self) -> list[str]:
        """Columns of the table."""

        def share(part: int, of: int) -> str:
            return f"{part / of:.2f}" if of else ""

        delay = f"{np.median(self.delays):.2f}" if self.delays else ""
        return [
            f"{self.false / self.hours:.1f}",
            share(self.told, self.performances),
            share(self.counted, self.repetitions),
            share(self.close, self.sets),
            delay,
        ]


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--exercises", type=Path, required=True)
    parser.add_argument("--everyday", type=Path, required=True)
    parser.add_argument("--people", type=Path, nargs="+", default=[])
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--streams", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, splits = np.random.default_rng(given.seed), read_splits(given.splits)
    recognizer = Recognizer(given.weights)
    streams = [*exercises(whole(given.exercises), splits, given.streams, rng)]
    for path in given.people:
        streams += people(read_collection(path), splits, given.streams, rng)
    supports = [stream.support for stream in streams[:: max(1, len(streams) // given.streams)]]
    streams += everyday(read_collection(given.everyday), supports[: given.streams], rng)
    scores = {(stream.kind, tau): Score() for stream in streams for tau in TAUS}
    for number, stream in enumerate(streams, 1):
        actions = {label: [clip] for label, clip in stream.support.items()}
        support = SupportSet.from_clips(actions, recognizer)
        looks = looks_at(stream, support)
        for tau in TAUS:
            events = told(looks, support.with_tau(tau))
            scores[stream.kind, tau].add(stream.clip.duration, stream.truth, events)
        print(f"{number} of {len(streams)} streams: {stream.kind}", flush=True)
    print(
        "\n| streams | hours | tau | false events an hour | performances told | repetitions "
        "told | sets within one | told after, s |"
    )
    print("|" + " --- |" * 8)
    for (kind, tau), score in scores.items():
        print("|", " | ".join([kind, f"{score.hours:.1f}", f"{tau}", *score.cells()]), "|")


if __name__ == "__main__":
    main()
