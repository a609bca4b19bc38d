"""The support set on disk: what was enrolled, in one SQLite file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.errors import StoreError, SupportError, UsageError
from actioncli.store.backup import changing
from actioncli.store.cache import Snapshot, read_embeddings, rename_embeddings, write_embeddings
from actioncli.store.database import reading
from actioncli.store.examples import (
    Example,
    Inserted,
    holds_negatives,
    insert,
    list_examples,
    read_outlines,
    read_record,
    read_records,
    rename_examples,
    require,
    require_label,
    stored_label,
)
from actioncli.store.location import exists, exposure, store_path
from actioncli.store.names import check_label
from actioncli.store.settings import put_setting, read_settings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from actioncli.clips.clip import Clip
    from actioncli.store.repair import Repair

__all__ = ["Action", "Example", "Inserted", "SupportStore"]


@dataclass(frozen=True)
class Action:
    """One label: how many examples it has, how long they last together, when the last came."""

    label: str
    examples: int
    seconds: float
    last_added: str
    negative: bool

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        names = ("label", "negative", "examples", "seconds", "last_added")
        return {name: getattr(self, name) for name in names}


class SupportStore:
    """The enrolled examples: actions to recognise, and negatives that must never be accepted.

    Every method is one transaction. A store that does not exist yet is an empty support set, and
    only what adds to it creates it. A label holds either an action or negatives.

    Args:
        path: the file; `$ACTIONCLI_HOME/support.db` where None, else the user's data folder.

    Raises:
        StoreError: from every method, where the file cannot be opened, read or written.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self.path = store_path(path)

    def __enter__(self) -> SupportStore:
        return self

    def __exit__(self, *exception: object) -> None:
        """Nothing to do: no file stays open between two calls."""

    def __repr__(self) -> str:
        return f"SupportStore({str(self.path)!r})"

    def enroll(self, label: str, clip: Clip, note: str = "", negative: bool = False) -> Inserted:
        """Keep a clip as an example of an action. When this returns, it is on the disk.

        Raises:
            UsageError: the label is not allowed, or holds the other kind of examples.
            ClipError: the clip is too large to keep, or its joint names are not printable.
        """
        return self.enroll_all([(label, clip)], note, negative)[0]

    def enroll_all(
        self,
        clips: Iterable[tuple[str, Clip]],
        note: str = "",
        negative: bool = False,
        embeddings: Sequence[NDArray[np.float32]] = (),
        weights_checksum: str = "",
        missing: Mapping[int, NDArray[np.float32]] | None = None,
    ) -> list[Inserted]:
        """Keep all of the labelled clips, or none; one answer for each, in order.

        Args:
            embeddings: (F, E) of each clip, or none, to be kept beside them.
            weights_checksum: names the weights that computed the embeddings.
            missing: (F, E) by example, of those that are there and had none for these weights.

        Raises:
            UsageError, ClipError: as `enroll`.
        """
        from actioncli.store.record import Record

        # Everything that can fail or take long is done before the store is locked.
        records = [Record.from_clip(label, clip, note, negative) for label, clip in clips]
        if not records:
            return []
        with changing(self.path) as db:
            enrolled = [insert(db, record) for record in records]
            if len(embeddings):
                fresh = zip([one.example for one in enrolled], embeddings, strict=True)
                write_embeddings(db, weights_checksum, {**(missing or {}), **dict(fresh)})
            return enrolled

    def actions(self) -> list[Action]:
        """What is enrolled, by label."""
        with reading(self.path) as db:
            actions: list[Action] = []
            # Fetched at once: a cursor would live on with an error, and keep the store locked.
            for label, examples, seconds, added, negative in db.execute(
                "SELECT label, count(*), total((frames - 1) / fps), max(added), max(negative) "
                "FROM examples GROUP BY label ORDER BY label"
            ).fetchall():
                require_label(label)
                require(str, added)
                actions.append(Action(label, examples, seconds, added, bool(negative)))
            return actions

    def examples(self, label: str | None = None) -> list[Example]:
        """The examples of a label, or all, by label and in the order of enrolment.

        Raises:
            SupportError: the label is not enrolled.
        """
        with reading(self.path) as db:
            if label is not None:
                label = stored_label(db, label)
            return list_examples(db, label)

    def clip(self, example: int) -> Clip:
        """The clip of an example.

        Raises:
            SupportError: there is no such example.
        """
        with reading(self.path) as db:
            # As text, for a number that someone typed may exceed SQLite's integers.
            found = db.execute("SELECT 1 FROM examples WHERE id = ?", (str(example),))
            if found.fetchone() is None:
                raise SupportError(
                    f"There is no example {example} in {self.path}; `actioncli show LABEL` lists "
                    "those of an action."
                )
            record = read_record(db, self.path, example)
        return record.clip()

    def support(self) -> dict[str, list[Clip]]:
        """The clips of each action, in the order of enrolment; without the negatives."""
        clips: dict[str, list[Clip]] = {}
        with reading(self.path) as db:
            for _, record in read_records(db, self.path, "NOT negative"):
                clips.setdefault(record.label, []).append(record.clip())
        return {label: clips[label] for label in sorted(clips)}

    def negatives(self) -> list[Clip]:
        """The clips that must never be accepted, in the order of enrolment."""
        with reading(self.path) as db:
            return [record.clip() for _, record in read_records(db, self.path, "negative")]

    def snapshot(self, weights_checksum: str, settings: Collection[str] = ()) -> Snapshot:
        """What is enrolled at one moment, with the embeddings for these weights.

        Args:
            weights_checksum: names the weights that computed the embeddings.
            settings: names of the settings that are wanted too.

        Raises:
            StoreError: an example without an embedding is damaged, or a setting is.
        """
        with reading(self.path) as db:
            examples = list_examples(db)
            embeddings = read_embeddings(db, weights_checksum)
            lacking = [each.id for each in examples if each.id not in embeddings]
            records = {number: read_record(db, self.path, number) for number in lacking}
            found: dict[str, str] = {}
            for wanted in settings:
                found |= read_settings(db, self.path, wanted)
        clips = {number: record.clip() for number, record in records.items()}
        return Snapshot(tuple(examples), embeddings, clips, found)

    def keep_embeddings(
        self, weights_checksum: str, embeddings: Mapping[int, NDArray[np.float32]]
    ) -> None:
        """Keep (F, E) embeddings by example for later queries; those of other weights go."""
        with changing(self.path) as db:
            write_embeddings(db, weights_checksum, embeddings)

    def remove(self, label: str, example: int | None = None) -> int:
        """Forget a label, or one example of it; how many examples are gone.

        Raises:
            SupportError: the label is not enrolled, or the example is none of its.
        """
        with reading(self.path) as db:
            stored_label(db, label)  # an unknown label must not create the store
        with changing(self.path, erases=True) as db:
            label = stored_label(db, label)
            removed = db.execute(
                "DELETE FROM examples WHERE label = ?1 AND (?2 IS NULL OR id = ?2)",
                (label, None if example is None else str(example)),
            ).rowcount
            if not removed:
                raise SupportError(
                    f"`{label}` has no example {example}; `actioncli show` lists those it has."
                )
            return removed

    def rename(
        self, old: str, new: str, settings: Mapping[str, Callable[[str], str]] | None = None
    ) -> int:
        """Give a label another name; how many examples it has.

        Args:
            settings: what to make of the texts of settings in the same transaction, by name.

        Raises:
            SupportError: the label is not enrolled.
            UsageError: the new one is not allowed, or is enrolled already.
        """
        new = check_label(new)
        with reading(self.path) as db:
            stored_label(db, old)  # an unknown label must not create the store
        with changing(self.path) as db:
            old = stored_label(db, old)
            if new != old and holds_negatives(db, new) is not None:
                raise UsageError(
                    f"`{new}` is enrolled already; remove it first or choose another name."
                )
            rename_embeddings(db, old, new)
            for name, change in (settings or {}).items():
                with suppress(StoreError):  # one that is damaged stays so
                    for value in read_settings(db, self.path, name).values():
                        put_setting(db, name, change(value))
            return rename_examples(db, self.path, old, new)

    def clear(self, settings: bool = False) -> int:
        """Forget all examples; how many there were.

        Args:
            settings: forget the settings too; else they stay.
        """
        if not exists(self.path):
            return 0
        with changing(self.path, erases=True) as db:
            if settings:
                db.execute("DELETE FROM settings")
            return db.execute("DELETE FROM examples").rowcount

    def export(self, path: str | Path) -> int:
        """Write all examples to one portable file, and the settings; how many examples there are.

        The format is described in `actioncli.store.archive`. An older export of that name is
        replaced, any other file is not.

        Raises:
            SupportError: nothing is enrolled.
            StoreError: the file cannot be written, or something else of that name is there.
        """
        from actioncli.store.archive import write_archive

        with reading(self.path) as db:
            (count,) = db.execute("SELECT count(*) FROM examples").fetchone()
            if not count:
                raise SupportError(f"Nothing is enrolled in {self.path}: nothing to export.")
            write_archive(
                Path(path).absolute(),
                read_outlines(db, self.path),
                (record for _, record in read_records(db, self.path)),
                read_settings(db, self.path),
            )
        return int(count)

    def import_(self, path: str | Path) -> tuple[int, int]:
        """Add the examples of an export; how many were added, and how many were there already.

        All of them or none: a file that is damaged or hostile is refused whole. A store without
        examples and settings takes those of the file too, and then decides as the other one did;
        a threshold that was measured on other examples would be wrong.

        Raises:
            StoreError: the file cannot be read as an export, or clashes with the store.
        """
        from actioncli.store.archive import carried_settings, read_archive

        path = Path(path).absolute()
        # Once to the end before the store is created or locked, and once more to add.
        if sum(1 for _ in read_archive(path)) == 0:
            return 0, 0
        with changing(self.path) as db:
            if not any(
                db.execute(f"SELECT 1 FROM {table} LIMIT 1").fetchone()
                for table in ("examples", "settings")
            ):
                for name, value in carried_settings(path).items():
                    put_setting(db, name, value)
            try:
                outcomes = [insert(db, record).added for record in read_archive(path)]
            except UsageError as error:
                raise StoreError(f"{path}: {error} Nothing was imported.") from error
        return sum(outcomes), len(outcomes) - sum(outcomes)

    def setting(self, name: str) -> str | None:
        """A value that was set before, or None.

        Raises:
            StoreError: it is not what was set.
        """
        with reading(self.path) as db:
            return read_settings(db, self.path, name).get(name)

    def set_setting(self, name: str, value: str | None) -> None:
        """Remember a value; None forgets it, if there is one."""
        if value is None and not exists(self.path):
            return  # forgetting must not create a store
        with changing(self.path, erases=value is None) as db:
            if value is None:
                db.execute("DELETE FROM settings WHERE name = ?", (name,))
            else:
                put_setting(db, name, value)

    def check(self) -> list[str]:
        """What is wrong with the store, a line for each problem; empty where all is well.

        Looks at the database's structure, every example's content and checksum, the cached
        embeddings, and who may read the file.
        """
        from actioncli.store.backup import is_lost, lost_store
        from actioncli.store.health import damage

        try:
            found = exposure(self.path) if exists(self.path) else []
        except StoreError as error:
            return [str(error)]
        found += damage(self.path)
        return found or ([lost_store(self.path)] if is_lost(self.path) else [])

    def backup_flaw(self) -> str | None:
        """What is wrong with the copy of the store beside it; None where it is as it should be."""
        from actioncli.store.backup import backup_flaw

        return backup_flaw(self.path)

    def repair(self) -> Repair | None:
        """Put a whole store, with what a damaged one still holds, in its place.

        The damaged file is kept beside it. None, and nothing done, where nothing is damaged.

        Raises:
            StoreError: another process uses the store, nothing of a support set is in it, it is
                one of a newer release, or there is no room for a second one.
        """
        from actioncli.store.repair import repair

        return repair(self.path)
