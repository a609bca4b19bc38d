"""One process of a round: it does random things to a store and tells each before and after.

Every line on its pipe is a JSON list: `["begin", what, state, tau]` with what the process's own
labels will hold if it succeeds, then `["ok"]`, or `["error", message]` where the store refused.
A worker owns the labels that begin with its name, so that what they hold depends on it alone.
"""

import json
import os
import random
import sys
import unicodedata  # noqa: F401 - a process without rights on the interpreter cannot import it
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import actioncli.store.archive
import actioncli.store.record
from actioncli.clips.clip import Clip, FloatArray
from actioncli.errors import StoreError
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold
from actioncli.store import database
from actioncli.store.store import SupportStore

# From a label to the numbers of its clips, in the order of enrolment.
State = dict[str, list[int]]


@dataclass(frozen=True)
class Task:
    """What a worker does.

    Attributes:
        name: begins its labels.
        seed: of its choices.
        store: file of the store.
        folder: where exports go and imports come from.
        steps: how many things it does.
        frames: length of its clips; long ones fill a disk.
        patience: seconds to wait for a lock.
        tau: the threshold that stands already; also says that this worker may change it.
    """

    name: str
    seed: int
    store: str
    folder: str
    steps: int
    frames: int = 6
    patience: float = 60.0
    tau: float | None = None


@cache
def make_clip(number: int, frames: int) -> Clip:
    """The clip of that number."""
    joints = np.random.default_rng(number).normal(size=(frames, 4, 3))
    return Clip(joints, [f"joint{place}" for place in range(4)], 25.0, source="clip.npy")


def checksum(number: int, frames: int) -> str:
    """The content checksum of a clip."""
    return actioncli.store.record.Record.from_clip("x", make_clip(number, frames)).checksum


class Worker:
    """Runs a task and reports on a pipe."""

    def __init__(self, task: Task, pipe: int) -> None:
        self.task = task
        self.random = random.Random(f"{task.seed} {task.name}")
        self.store = SupportStore(task.store)
        self.pipe = pipe
        self.state: State = {}
        self.tau = task.tau
        self.number = task.seed * 100_000 + sum(map(ord, task.name)) % 97 * 1000
        database.PATIENCE = task.patience

    def tell(self, *line: object) -> None:
        """Write a line; it is in the pipe when this returns, whatever happens then."""
        os.write(self.pipe, json.dumps(line).encode() + b"\n")

    def run(self) -> None:
        """Do all steps."""
        kinds = ["enroll"] * 4 + ["rename", "remove", "export", "import", "classify"]
        if self.tau is not None:
            kinds.append("calibrate")
        for _ in range(self.task.steps):
            kind = self.random.choice(kinds)
            if kind in {"rename", "remove", "export"} and not self.state:
                kind = "enroll"
            state, tau = self.state, self.tau
            try:
                getattr(self, kind)()
            except StoreError as error:
                self.state, self.tau = state, tau
                self.tell("error", str(error))
            else:
                self.tell("ok")

    def begin(self, what: str, state: State, tau: float | None = None) -> None:
        """Tell what is about to happen."""
        self.state = {label: held for label, held in state.items() if held}
        self.tau = self.tau if tau is None else tau
        self.tell("begin", what, self.state, self.tau)

    def fresh(self) -> int:
        """The number of a clip that nobody else uses."""
        self.number += 1
        return self.number

    def copied(self) -> State:
        """The state, to be changed."""
        return {label: list(held) for label, held in self.state.items()}

    def enroll(self) -> None:
        """One to three clips at once, under one or two labels."""
        state = self.copied()
        clips = []
        for _ in range(self.random.randint(1, 3)):
            label = f"{self.task.name} {self.random.choice('abc')}"
            number = self.fresh()
            state.setdefault(label, []).append(number)
            clips.append((label, make_clip(number, self.task.frames)))
        self.begin("enroll", state)
        assert all(answer.added for answer in self.store.enroll_all(clips))

    def rename(self) -> None:
        """A label becomes one that is new."""
        state = self.copied()
        old = self.random.choice(sorted(state))
        new = f"{self.task.name} {self.fresh()}"
        state[new] = state.pop(old)
        self.begin("rename", state)
        assert self.store.rename(old, new) == len(state[new])

    def remove(self) -> None:
        """A label, or one example of it."""
        state = self.copied()
        label = self.random.choice(sorted(state))
        if self.random.random() < 0.5:
            del state[label]
            self.begin("remove", state)
            self.store.remove(label)
            return
        place = self.random.randrange(len(state[label]))
        del state[label][place]
        self.begin("remove", state)
        self.store.remove(label, self.store.examples(label)[place].id)

    def export(self) -> None:
        """The whole store, to a new file whose name tells what it holds of this worker."""
        number = self.fresh()
        self.begin(f"export {number}", self.copied())
        self.store.export(Path(self.task.folder) / f"{self.task.name} {number}.safetensors")

    def import_(self) -> None:
        """Two clips from an export that was made elsewhere."""
        state = self.copied()
        numbers = [self.fresh(), self.fresh()]
        label = f"{self.task.name} imported"
        state.setdefault(label, []).extend(numbers)
        other = Path(self.task.folder) / f"{self.task.name} {numbers[0]}"
        file = other.with_suffix(".safetensors")
        source = SupportStore(other.with_suffix(".db"))
        try:
            source.enroll_all([(label, make_clip(each, self.task.frames)) for each in numbers])
            source.export(file)
        except StoreError as error:
            # Nothing has begun; a full disk has no room for what would be imported either.
            self.tell("begin", "nothing", self.state, self.tau)
            raise error
        self.begin("import", state)
        assert self.store.import_(file) == (2, 0)

    locals()["import"] = import_

    def classify(self) -> None:
        """What a query needs: the clip of every example that has no embedding, which is all."""
        self.begin("classify", self.copied())
        snapshot = self.store.snapshot("w")
        found: dict[str, list[FloatArray]] = {}
        for example in snapshot.examples:
            if example.label.startswith(f"{self.task.name} "):
                found.setdefault(example.label, []).append(snapshot.clips[example.id].joints)
        assert found.keys() == self.state.keys(), found.keys()
        for label, held in self.state.items():
            for joints, number in zip(found[label], held, strict=True):
                assert np.array_equal(joints, make_clip(number, self.task.frames).joints)
        assert not self.tau or kept_threshold(self.store) is not None

    def calibrate(self) -> None:
        """A new threshold is kept, or the last one is forgotten, which counts as 0."""
        tau = 0.0 if self.random.random() < 0.4 else round(self.random.uniform(0.01, 0.99), 6)
        self.begin("calibrate", self.copied(), tau)
        keep_threshold(self.store, Threshold(tau, "w") if tau else None)


if __name__ == "__main__":
    Worker(Task(**json.loads(sys.argv[1])), 1).run()
