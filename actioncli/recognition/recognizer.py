"""The face of the library: clips in, decisions out.

One clip's way: `prepare` → `embed` → `compare` with each enrolled action → `decide`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from actioncli.clips.checks import is_still
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import cut
from actioncli.clips.view import view_notes
from actioncli.errors import SupportError, UsageError, WeightsError
from actioncli.model import paper_compare, parts_compare
from actioncli.model.arrays import sigmoid, softmax
from actioncli.model.config import PartsConfig
from actioncli.model.weights import Weights, read_weights
from actioncli.recognition.decision import Comparison, Decision, decide
from actioncli.recognition.threshold import DEFAULT_TAU, Threshold
from actioncli.recognition.windows import mean_durations, most_windows, odds_factor, windows

# Clips and windows that are embedded and compared at a time, and their frames: each clip takes a
# quarter of a megabyte, and another one for every thousand frames.
_AT_ONCE, _FRAMES_AT_ONCE = 256, 2**15
# The least distance, as odds, where nobody moves.
_FAR = 1000


class _Enrolled(NamedTuple):
    """What queries are decided by: embeddings (n, F, E) of actions and of single negatives, what
    `classify` takes beside them, and what is called with how many clips have been compared."""

    actions: Mapping[str, FloatArray]
    negatives: Mapping[str, FloatArray]
    durations: Sequence[float]
    threshold: Threshold
    advance: Callable[[int], None]


class Recognizer:
    """One-shot open-set recognition with trained weights."""

    name = "trx-os"

    def __init__(self, weights: Weights | str | Path | None = None) -> None:
        """Take weights, or read them; without a path those that came with the package.

        Raises:
            WeightsError: the weights cannot be read.
        """
        self.weights = weights if isinstance(weights, Weights) else read_weights(weights)

    @property
    def cohort(self) -> FloatArray:
        """Other people's motions that came with the weights: embeddings (C, F, E), C may be 0."""
        cohort = self.weights.tensors.get("cohort")
        return self.embed([]) if cohort is None else cohort

    def embed(self, clips: Sequence[Clip] | FloatArray) -> FloatArray:
        """What comparison needs of each clip.

        Args:
            clips: N of them; embeddings are given back as they are.

        Returns:
            (N, F, E) float32.

        Raises:
            ClipError: a clip lacks joints that the model reads.
        """
        if isinstance(clips, np.ndarray):
            return clips
        for clip in clips:
            if not isinstance(clip, Clip):
                raise UsageError(f"{clip!r} is no clip; read it first: actioncli.read_clip(path).")
        config = self.weights.config
        if isinstance(config, PartsConfig):
            return parts_compare.embed(self.weights.tensors, config, clips)
        return paper_compare.embed(self.weights.tensors, config, clips)

    def compare(
        self,
        queries: Sequence[Clip] | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
    ) -> Comparison:
        """Compare queries with every enrolled action.

        Args:
            queries: Q clips, or their embeddings (Q, F, E).
            support: the examples of each action, clips or embeddings (n, F, E).

        Raises:
            SupportError: no action, or an action without examples.
            WeightsError: a score is no number.
        """
        if not support:
            raise SupportError("the support set is empty; enrol an action first.")
        query = self.embed(queries)
        examples = {label: self.embed(clips) for label, clips in support.items()}
        for label, embedding in examples.items():
            if not len(embedding):
                raise SupportError(f"the action {label!r} has no examples.")
        config = self.weights.config
        params, actions = self.weights.tensors, list(examples.values())
        if isinstance(config, PartsConfig):
            distance, logit = parts_compare.scores(params, config, query, actions)
        else:
            distance, logit = paper_compare.scores(params, config, query, actions)
        # Finite weights may be so large that sums of them are not.
        if np.isnan(distance).any() or np.isnan(logit).any():
            raise WeightsError(
                f"{self.weights.path}: gives scores that are no numbers; train again."
            )
        return Comparison(
            labels=np.array(list(support)),
            distance=distance,
            confidence=sigmoid(logit),
            probability=softmax(logit if config.distance_is_odds else -distance),
        )

    def classify(
        self,
        clip: Clip | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
        tau: float | Threshold = DEFAULT_TAU,
        negatives: Sequence[Clip] | FloatArray | None = None,
        durations: Iterable[float] | None = None,
    ) -> Decision:
        """Find the nearest enrolled action and accept or reject it.

        In a clip that is much longer than the enrolled ones, the action may be a part: windows
        then compete with the whole, and the decision is about the part that shows an action
        best, see `recognition.windows`. The odds 1 / confidence - 1 of a window are multiplied by
        `odds_factor` of the number of windows; where distances are odds, so are they. Where nobody
        moves the confidence is 0, and no such window is chosen.

        Args:
            clip: the query, or its embedding (F, E).
            support: as in `compare`.
            tau: accept where the confidence is above it; or thresholds of single actions.
            negatives: what must never be accepted, N clips or embeddings (N, F, E), each an
                action of its own: a query that is nearer to one of them than to every enrolled
                action is rejected, whatever its confidence. Of a long clip, windows that are
                nearer to a negative are left out; if a negative's confidence in the whole clip
                is above tau, no window is looked at.
            durations: mean duration of each action's examples, seconds; None takes them from
                the actions that are given as clips. () compares the clip as a whole.

        Raises:
            ClipError: a clip lacks joints that the model reads.
            SupportError: no action, or an action without examples.
        """
        clips = [clip] if isinstance(clip, Clip) else np.asarray(clip)[None]
        return self.classify_all(clips, support, tau, negatives, durations)[0]

    def classify_all(
        self,
        clips: Sequence[Clip] | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
        tau: float | Threshold = DEFAULT_TAU,
        negatives: Sequence[Clip] | FloatArray | None = None,
        durations: Iterable[float] | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> list[Decision]:
        """`classify` for each of many clips; together they take a fraction of the time.

        Args:
            clips: N queries, or their embeddings (N, F, E); the rest is as in `classify`.
            progress: called now and then with how many clips and windows of them have been
                compared, and how many there are at most.

        Returns:
            N decisions.

        Raises:
            ClipError, SupportError: as `classify`.
        """
        if not len(clips):
            return []
        if durations is None:
            durations = mean_durations(
                (label, example.duration)
                for label, examples in support.items()
                if not isinstance(examples, np.ndarray)
                for example in examples
            ).values()
        lasting = tuple(durations)
        done, most = 0, 0
        if progress and not isinstance(clips, np.ndarray):
            most = sum(1 + most_windows(clip, lasting) for clip in clips)

        def advance(count: int) -> None:
            nonlocal done
            done += count
            if progress:
                progress(done, most)

        apart = self.embed(() if negatives is None else negatives)
        enrolled = _Enrolled(
            actions={label: self.embed(examples) for label, examples in support.items()},
            negatives={str(n): apart[n : n + 1] for n in range(len(apart))},
            durations=lasting,
            threshold=tau if isinstance(tau, Threshold) else Threshold(tau, self.weights.checksum),
            advance=advance,
        )
        decisions = []
        for block in [clips] if isinstance(clips, np.ndarray) else _blocks(clips):
            embedded = self.embed(block)
            comparison = self.compare(embedded, enrolled.actions)
            advance(len(block))
            for row, clip in enumerate(block):
                decisions.append(self._decide(clip, embedded[[row]], comparison, row, enrolled))
        return decisions

    def _decide(
        self,
        clip: Clip | FloatArray,
        whole: FloatArray,
        compared: Comparison,
        row: int,
        enrolled: _Enrolled,
    ) -> Decision:
        """Decide about a clip, embedded (1, F, E) and compared as a whole, or a window of it."""
        first = compared.distance, compared.confidence, compared.probability
        found = [tuple(values[[row]] for values in first)]
        notes: tuple[str, ...] = ()
        spans: list[tuple[float, float]] = []
        still = False
        if isinstance(clip, Clip):
            notes, still = clip.notes + view_notes(clip), is_still(clip)
            spans = [(clip.start, clip.start + clip.duration)]
            # Of ten thousand windows only what their comparison gives is kept.
            for block in _blocks(() if still else windows(clip, enrolled.durations)):
                of_block = self.compare(self.embed(block), enrolled.actions)
                found.append((of_block.distance, of_block.confidence, of_block.probability))
                spans += [(part.start, part.start + part.duration) for part in block]
                enrolled.advance(len(block))
        distance, confidence, probability = map(np.concatenate, zip(*found, strict=True))
        count = len(distance) - 1
        odds = np.float32(odds_factor(count))
        odds_are_distance = self.weights.config.distance_is_odds
        factor = odds if odds_are_distance else np.float32(1)
        confidence[1:] /= confidence[1:] + (1 - confidence[1:]) * odds
        distance[1:] *= factor
        if still:
            notes += ("nobody moves, so it shows no action",)
            confidence = np.zeros_like(confidence)
            if odds_are_distance:
                distance = np.maximum(distance, np.float32(_FAR))

        def window(row: int) -> Clip:
            assert isinstance(clip, Clip)
            start, end = (time - clip.start for time in spans[row])
            return cut(clip, start, end)

        def beside_negatives(row: int) -> tuple[bool, float | None, float]:
            """Whether the nearest negative is nearer than every action, its distance and its
            confidence."""
            if not enrolled.negatives:
                return False, None, 0.0
            apart = self.compare(self.embed([window(row)]) if row else whole, enrolled.negatives)
            at = apart.distance[0].argmin()
            away = apart.distance[0, at] * (factor if row else 1)
            nearer = bool(away < distance[row].min())
            return nearer, float(away), float(apart.confidence[0, at])

        # A clip that shows a negative is rejected as a whole; a window like one is left out, and
        # one in which nobody moves.
        of_whole = beside_negatives(0)
        nearer, negative, confidence_of_whole = of_whole
        best = 0
        if not nearer or confidence_of_whole <= enrolled.threshold.tau:
            surest = confidence[np.arange(count + 1), distance.argmin(axis=1)]
            for each in np.argsort(-surest, kind="stable").tolist():
                if each and is_still(window(each)):
                    continue
                nearer, away, _ = beside_negatives(each) if each else of_whole
                if not nearer:
                    best, negative = each, away
                    break
        if best:
            start, end = spans[best]
            notes += (f"matched {start:.1f} s to {end:.1f} s, the surest of {count} windows",)
        comparison = Comparison(compared.labels, distance, confidence, probability)
        part = spans[best] if spans else None
        return decide(comparison, best, enrolled.threshold, negative, notes, part)


def _blocks(clips: Iterable[Clip]) -> Iterator[list[Clip]]:
    """As many at a time as memory is meant for."""
    block: list[Clip] = []
    frames = 0
    for clip in clips:
        block.append(clip)
        frames += len(clip)
        if len(block) == _AT_ONCE or frames >= _FRAMES_AT_ONCE:
            yield block
            block, frames = [], 0
    if block:
        yield block
