"""Whatever is done in whatever order: the store holds what a dictionary would."""

import shutil
import tempfile
from pathlib import Path

import pytest
from cases import cases
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from storing import make_clip, same

from actioncli.errors import SupportError, UsageError
from actioncli.store.store import SupportStore

LABELS = st.sampled_from(["wave", "clap", "手", "a b"])
SEEDS = st.integers(0, 5)


class StoreModel(RuleBasedStateMachine):
    """`expected` maps a label to whether it holds negatives and to the seeds of its clips."""

    @initialize()
    def start(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.store = SupportStore(self.folder / "support.db")
        self.expected: dict[str, tuple[bool, list[int]]] = {}
        self.exported: dict[str, tuple[bool, list[int]]] = {}

    def teardown(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    @rule(label=LABELS, seeds=st.lists(SEEDS, min_size=1, max_size=3), negative=st.booleans())
    def enroll(self, label: str, seeds: list[int], negative: bool) -> None:
        clips = [(label, make_clip(seed, confidence=seed % 2 == 0)) for seed in seeds]
        held, there = self.expected.get(label, (negative, []))
        if held != negative:
            with pytest.raises(UsageError):
                self.store.enroll_all(clips, negative=negative)
            return
        there = list(there)
        added = []
        for seed in seeds:
            added.append(seed not in there)
            if added[-1]:
                there.append(seed)
        answers = self.store.enroll_all(clips, negative=negative)
        assert [answer.added for answer in answers] == added
        self.expected[label] = (negative, there)

    @rule(label=LABELS)
    def remove(self, label: str) -> None:
        if label in self.expected:
            assert self.store.remove(label) == len(self.expected.pop(label)[1])
        else:
            with pytest.raises(SupportError):
                self.store.remove(label)

    @rule(label=LABELS, place=st.integers(0, 5))
    def remove_one(self, label: str, place: int) -> None:
        negative, seeds = self.expected.get(label, (False, []))
        if place < len(seeds):
            assert self.store.remove(label, self.store.examples(label)[place].id) == 1
            left = [seed for at, seed in enumerate(seeds) if at != place]
            self.expected[label] = (negative, left)
            if not left:
                del self.expected[label]

    @rule(old=LABELS, new=LABELS)
    def rename(self, old: str, new: str) -> None:
        if old not in self.expected:
            with pytest.raises(SupportError):
                self.store.rename(old, new)
        elif new != old and new in self.expected:
            with pytest.raises(UsageError):
                self.store.rename(old, new)
        else:
            assert self.store.rename(old, new) == len(self.expected[old][1])
            self.expected[new] = self.expected.pop(old)

    @rule()
    def clear(self) -> None:
        assert self.store.clear() == sum(len(seeds) for _, seeds in self.expected.values())
        self.expected = {}

    @rule()
    def export(self) -> None:
        if self.expected:
            count = sum(len(seeds) for _, seeds in self.expected.values())
            assert self.store.export(self.folder / "export") == count
            self.exported = {label: (n, list(seeds)) for label, (n, seeds) in self.expected.items()}

    @rule()
    def import_(self) -> None:
        clash = any(
            label in self.expected and self.expected[label][0] != negative
            for label, (negative, _) in self.exported.items()
        )
        if not self.exported or clash:
            return
        added = skipped = 0
        for label, (negative, seeds) in self.exported.items():
            there = list(self.expected.get(label, (negative, []))[1])
            fresh = [seed for seed in seeds if seed not in there]
            added += len(fresh)
            skipped += len(seeds) - len(fresh)
            self.expected[label] = (negative, there + fresh)
        assert self.store.import_(self.folder / "export") == (added, skipped)

    @invariant()
    def holds_what_is_expected(self) -> None:
        if not hasattr(self, "store"):
            return
        assert self.store.check() == []
        assert [
            (action.label, action.negative, action.examples) for action in self.store.actions()
        ] == [(label, n, len(seeds)) for label, (n, seeds) in sorted(self.expected.items())]
        support = self.store.support()
        actions = {label: seeds for label, (n, seeds) in self.expected.items() if not n}
        assert support.keys() == actions.keys()
        for label, seeds in actions.items():
            for clip, seed in zip(support[label], seeds, strict=True):
                assert same(clip, make_clip(seed, confidence=seed % 2 == 0))


TestStoreModel = StoreModel.TestCase
TestStoreModel.settings = settings(
    max_examples=cases(30), stateful_step_count=20, suppress_health_check=[HealthCheck.too_slow]
)
