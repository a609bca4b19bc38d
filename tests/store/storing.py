"""What the tests of the store share: small clips, and children that can be killed or demoted."""

import os
import signal
import sqlite3
import unicodedata  # noqa: F401 - a child without rights on the interpreter cannot import it
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

import actioncli.store.archive
import actioncli.store.record  # noqa: F401 - likewise
from actioncli.clips.clip import Clip
from actioncli.store.database import writing
from actioncli.store.store import SupportStore
from tests.forking import NOBODY, fork


def make_clip(
    seed: int, frames: int = 6, joints: int = 4, confidence: bool = False, source: str = "clip.npy"
) -> Clip:
    """A small clip that differs for each seed."""
    rng = np.random.default_rng(seed)
    return Clip(
        rng.normal(size=(frames, joints, 3)),
        [f"joint{place}" for place in range(joints)],
        25.0,
        rng.random((frames, joints)) if confidence else None,
        source,
    )


def same(first: Clip, second: Clip) -> bool:
    """Whether two clips have the same content, bit for bit."""
    return (
        np.array_equal(first.joints, second.joints)
        and first.joint_names == second.joint_names
        and first.fps == second.fps
        and (first.confidence is None) == (second.confidence is None)
        and (
            first.confidence is None
            or second.confidence is None
            or np.array_equal(first.confidence, second.confidence)
        )
    )


def succeeded(child: int) -> bool:
    """Wait for a child; whether it ended well."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def alter(path: Path, *statements: str) -> None:
    """Change a store behind its back."""
    with closing(sqlite3.connect(path)) as db:
        for statement in statements:
            db.execute(statement)
        db.commit()


def interrupt(store: SupportStore, *statements: str) -> Path:
    """Kill a process that writes to a store; the journal that it leaves."""

    def die_while_writing() -> None:
        with writing(store.path) as db:
            for statement in ("PRAGMA cache_spill = 1", "PRAGMA cache_size = 1", *statements):
                db.execute(statement)
            os.kill(os.getpid(), signal.SIGKILL)

    assert not succeeded(fork(die_while_writing))
    journal = store.path.with_name(store.path.name + "-journal")
    assert journal.stat().st_size > 0
    return journal


def as_ordinary_user(work: Callable[[], object]) -> bool:
    """Whether `work` succeeds without root's rights."""
    return succeeded(fork(work, ordinary=True))


def give_away(*paths: Path) -> None:
    """Make an ordinary user the owner, so that `as_ordinary_user` may use the files."""
    if os.geteuid() == 0:
        for path in paths:
            os.chown(path, NOBODY, NOBODY)
