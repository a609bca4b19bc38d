"""The face of the library: clips in, decisions out.

One clip's way: `prepare` → `trx_os.embed` → `compare` with each enrolled action → `decide`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from actioncli.clips.active import cut
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.prepare import prepare_all
from actioncli.errors import SupportError, WeightsError
from actioncli.model import compare
from actioncli.model.embedding import embed
from actioncli.model.weights import Weights, read_weights
from actioncli.recognition.decision import Comparison, Decision, decide
from actioncli.recognition.windows import odds_factor, windows

DEFAULT_TAU = 0.5
# Clips and windows that are embedded and compared at a time, and their frames: each clip takes a
# quarter of a megabyte, and another one for every thousand frames.
_AT_ONCE, _FRAMES_AT_ONCE = 256, 2**15

# When a part of a clip begins and ends, seconds of its source.
_Span = tuple[float, float]


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

    def embed(self, clips: Sequence[Clip]) -> FloatArray:
        """What comparison needs of each clip.

        Returns:
            (N, F, E) float32.

        Raises:
            ClipError: a clip lacks joints that the model reads.
        """
        return self._embed(clips)

    def _embed(self, clips: Sequence[Clip], queries: bool = False) -> FloatArray:
        """Without what only examples need, if all clips are queries."""
        config = self.weights.config
        frames = prepare_all(clips, config.preparation)
        return embed(self.weights.tensors, config, frames, queries)

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
        query = queries if isinstance(queries, np.ndarray) else self._embed(queries, queries=True)
        examples = {label: self._embedded(clips) for label, clips in support.items()}
        for label, embedding in examples.items():
            if not len(embedding):
                raise SupportError(f"the action {label!r} has no examples.")
        config = self.weights.config
        distance, logit = compare.scores(
            self.weights.tensors, config, query, list(examples.values())
        )
        # Finite weights may be so large that sums of them are not.
        if np.isnan(distance).any() or np.isnan(logit).any():
            raise WeightsError(
                f"{self.weights.path}: gives scores that are no numbers; train again."
            )
        return Comparison(
            labels=np.array(list(support)),
            distance=distance,
            confidence=compare.sigmoid(logit),
            probability=compare.softmax(logit if config.warp_width else -distance),
        )

    def classify(
        self,
        clip: Clip | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
        tau: float = DEFAULT_TAU,
        negatives: Sequence[Clip] | FloatArray | None = None,
        durations: Iterable[float] | None = None,
    ) -> Decision:
        """Find the nearest enrolled action and accept or reject it.

        In a clip that is much longer than the enrolled ones, the action may be a part: windows
        then compete with the whole, and the decision is about the part that shows an action
        best, see `recognition.windows`. The odds 1 / confidence - 1 of a window are multiplied by
        `odds_factor` of the number of windows; where distances are odds, so are they.

        Args:
            clip: the query, or its embedding (F, E).
            support: as in `compare`.
            tau: accept where the confidence is above it.
            negatives: what must never be accepted, N clips or embeddings (N, F, E), each an
                action of its own: a query that is nearer to one of them than to every enrolled
                action is rejected, whatever its confidence. Of a long clip, windows that are
                nearer to a negative are left out; if a negative's confidence in the whole clip
                is above tau, no window is looked at.
            durations: of the enrolled examples, seconds, for support that is given as
                embeddings; of clips they are known. () compares the clip as a whole, as does
                None where no example is a clip.

        Raises:
            SupportError: no action, or an action without examples.
        """
        clips = [clip] if isinstance(clip, Clip) else np.asarray(clip)[None]
        return self.classify_all(clips, support, tau, negatives, durations)[0]

    def classify_all(
        self,
        clips: Sequence[Clip] | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
        tau: float = DEFAULT_TAU,
        negatives: Sequence[Clip] | FloatArray | None = None,
        durations: Iterable[float] | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> list[Decision]:
        """`classify` for each of many clips; together they take a fraction of the time.

        Args:
            clips: N queries, or their embeddings (N, F, E); the rest is as in `classify`.
            progress: called now and then with how many clips, and windows of them (at most
                `actioncli.recognition.windows.most_windows`), have been compared.

        Returns:
            N decisions.

        Raises:
            ClipError: a clip lacks joints that the model reads.
            SupportError: no action, or an action without examples.
        """
        if not len(clips):
            return []
        examples = {label: self._embedded(of_action) for label, of_action in support.items()}
        lasting = tuple(_durations(support) if durations is None else durations)
        if isinstance(clips, np.ndarray):
            wholes, comparison = list(clips), self.compare(clips, examples)
            spans: list[list[_Span]] = [[] for _ in clips]
        else:
            wholes, comparison, spans = self._compare_parts(clips, lasting, examples, progress)
        # Once for all clips.
        kept = None if negatives is None or not len(negatives) else self._embedded(negatives)
        decisions, end = [], 0
        for number, clip in enumerate(clips):
            start, end = end, end + max(len(spans[number]), 1)
            rows = replace(
                comparison,
                distance=comparison.distance[start:end],
                confidence=comparison.confidence[start:end],
                probability=comparison.probability[start:end],
            )
            decisions.append(self._decide(clip, wholes[number], spans[number], rows, tau, kept))
        return decisions

    def _compare_parts(
        self,
        clips: Sequence[Clip],
        durations: Sequence[float],
        examples: Mapping[str, FloatArray],
        progress: Callable[[int], None] | None,
    ) -> tuple[list[FloatArray], Comparison, list[list[_Span]]]:
        """Compare each clip, and after it its windows, so many at a time that memory does not grow
        with their number.

        Returns:
            Embeddings of the whole clips; the comparison of all; and of each clip, when it and its
            windows begin and end.
        """
        spans: list[list[_Span]] = [[] for _ in clips]
        parts = (
            (number, part)
            for number, clip in enumerate(clips)
            for part in chain([clip], windows(clip, durations))
        )
        wholes, found, done = [], [], 0
        for block in _blocks(parts):
            embedded = self._embed([part for _, part in block], queries=True)
            found.append(self.compare(embedded, examples))
            for at, (number, part) in enumerate(block):
                if not spans[number]:
                    wholes.append(embedded[at].copy())  # not the whole block
                spans[number].append((part.start, part.start + part.duration))
            done += len(block)
            if progress:
                progress(done)
        comparison = Comparison(
            labels=found[0].labels,
            distance=np.concatenate([each.distance for each in found]),
            confidence=np.concatenate([each.confidence for each in found]),
            probability=np.concatenate([each.probability for each in found]),
        )
        return wholes, comparison, spans

    def _decide(
        self,
        clip: Clip | FloatArray,
        whole: FloatArray,
        spans: Sequence[_Span],
        comparison: Comparison,
        tau: float,
        negatives: FloatArray | None,
    ) -> Decision:
        """What the comparison of one clip, in its first row, and of its windows shows."""

        def embedded(row: int) -> FloatArray:
            if not (row and isinstance(clip, Clip)):
                return whole[np.newaxis]
            # Of ten thousand windows few are asked for: they are not kept.
            begin, end = (time - clip.start for time in spans[row])
            return self.embed([cut(clip, begin, end)])

        odds = odds_factor(len(spans) - 1)
        comparison = self._less_likely(comparison, odds)
        row, negative = self._surest(embedded, comparison, negatives, odds, tau)
        notes = clip.notes if isinstance(clip, Clip) else ()
        part = spans[row] if spans else None
        if part and row:
            notes += (
                f"matched {part[0]:.1f} s to {part[1]:.1f} s, the surest of "
                f"{len(spans) - 1} windows",
            )
        return decide(comparison, row, tau, negative, notes, part)

    def _less_likely(self, comparison: Comparison, odds: float) -> Comparison:
        """The comparison of a whole clip, in the first row, and its windows, whose odds against a
        match are multiplied."""
        confidence, distance = comparison.confidence.copy(), comparison.distance.copy()
        confidence[1:] /= confidence[1:] + (1 - confidence[1:]) * np.float32(odds)
        if self.weights.config.warp_width:
            distance[1:] *= np.float32(odds)
        return replace(comparison, confidence=confidence, distance=distance)

    def _surest(
        self,
        embedded: Callable[[int], FloatArray],
        comparison: Comparison,
        negatives: FloatArray | None,
        odds: float,
        tau: float,
    ) -> tuple[int, float | None]:
        """The row that decides, and its distance to the nearest negative, if there are any."""
        nearest = comparison.distance.argmin(axis=1)
        confidence = comparison.confidence[np.arange(len(nearest)), nearest]
        order = np.lexsort((-confidence,)).tolist()  # stable
        if negatives is None:
            return order[0], None
        kept = {str(n): negatives[n : n + 1] for n in range(len(negatives))}

        def like_negative(row: int) -> tuple[bool, float, float]:
            """Whether a negative is nearest, its distance and confidence."""
            apart = self.compare(embedded(row), kept)
            nearest = int(apart.distance[0].argmin())
            away = apart.distance[0, nearest]
            if row and self.weights.config.warp_width:
                away *= np.float32(odds)  # rounded like the distances that it is compared with
            shadowed = bool(away < comparison.distance[row].min())
            return shadowed, float(away), float(apart.confidence[0, nearest])

        # A clip that shows a negative is rejected as a whole; a window like one is left out.
        whole = like_negative(0)
        shadowed, away, confidence_of_whole = whole
        if shadowed and confidence_of_whole > tau:
            return 0, away
        for row in order:
            shadowed, away, _ = whole
            if row:
                shadowed, away, _ = like_negative(row)
            if not shadowed:
                return row, away
        return 0, whole[1]

    def _embedded(self, clips: Sequence[Clip] | FloatArray) -> FloatArray:
        return clips if isinstance(clips, np.ndarray) else self.embed(clips)


def _blocks(parts: Iterable[tuple[int, Clip]]) -> Iterator[list[tuple[int, Clip]]]:
    """As many at a time as memory is meant for."""
    block: list[tuple[int, Clip]] = []
    frames = 0
    for numbered in parts:
        block.append(numbered)
        frames += len(numbered[1])
        if len(block) == _AT_ONCE or frames >= _FRAMES_AT_ONCE:
            yield block
            block, frames = [], 0
    if block:
        yield block


def _durations(support: Mapping[str, Sequence[Clip] | FloatArray]) -> list[float]:
    """Of the examples that are clips, seconds."""
    return [
        clip.duration
        for clips in support.values()
        if not isinstance(clips, np.ndarray)
        for clip in clips
    ]
