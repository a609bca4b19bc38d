"""What the protocols measure: anything that compares queries with enrolled actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.recognition.decision import Comparison


class Scorer(Protocol):
    """A `Recognizer`, or a baseline with the same two steps."""

    @property
    def name(self) -> str:
        """How reports call it."""

    def embed(self, clips: Sequence[Clip]) -> NDArray[Any]:
        """All that comparison needs of N clips; the leading axis has length N."""

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """Compare Q embedded queries with K actions, each given by its embedded examples."""
