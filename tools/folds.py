"""Ways to hold actions back from the `train` classes, so that choices need no benchmark class.

`sensors 1` and `sensors 2` hold whole collections back: performers, sensors and actions that the
model never saw. `classes 1` and `classes 2` hold back about half of the actions of several
collections whose other actions are trained on, which is what the benchmark asks. Whatever shows a
held action under another name, or from another sensor, is left out of both training and asking.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from actioncli.clips.collection import Collection, read_collection
from actioncli.evaluation.splits import Split, Splits, read_splits

# Patterns of class names, by collection.
Patterns = Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class Fold:
    """Which classes are asked about, and which are neither asked about nor trained on."""

    held: Patterns
    alike: Patterns


FOLDS: Mapping[str, Fold] = {
    "classes 1": Fold(
        {
            "kinder_gator": [
                "draw_a_square", "draw_a_triangle", "draw_the_letter_a", "walk_in_place*",
                "put_your_hands_on_your_hips_and_*", "swipe_across_*",
            ],
            "utd_mhad": ["draw_triangle", "swipe_*", "walk", "arm_curl"],
            "kard": ["walk", "take_umbrella", "draw_tick", "drink", "stand_up"],
            "msrc12": ["push_right", "shoot", "change_weapon", "beat_both"],
        },
        {
            "msr_action3d": ["tennis_swing"],
            "bandai_namco": ["walk*", "dash"],
            "cad60": ["drinking_water"],
            "cmu_mocap_subset": ["*walk*"],
            "cc0_animations": [
                "walk*", "skeletons_walking", "lie_standup", "skeletons_awaken_standing",
                "consume_item", "pistol_shoot", "ranged_1h_shoot*", "push_loop",
            ],
        },
    ),
    "classes 2": Fold(
        {
            "kinder_gator": [
                "bend_your_*", "draw_the_letter_c", "draw_the_letter_k", "draw_the_letter_m",
                "push_an_imaginary_button_*", "raise_your_arm_*", "signal_someone_to_come_here",
            ],
            "utd_mhad": ["baseball_swing", "basketball_shoot", "catch", "tennis_serve"],
            "kard": ["catch_cap", "high_arm_wave", "horizontal_arm_wave", "toss_paper"],
            "msrc12": ["had_enough", "lift_outstretched_arms", "wind_it_up", "shoot"],
            "msr_action3d": [
                "hand_catch", "high_arm_wave", "horizontal_arm_wave", "tennis_serve",
            ],
        },
        {
            "ui_prmd_vicon": ["shoulder_scaption", "standing_straight_leg_raise"],
            "bandai_namco": ["bye*", "wave*"],
            "cmu_mocap_subset": ["*basketball*shoot*"],
            "cc0_animations": ["waving", "thow_object", "reject", "pistol_shoot"],
        },
    ),
    "sensors 1": Fold(
        {"kard": ["*"], "msr_action3d": ["*"], "ui_prmd_vicon": ["*"]},
        {
            "kinder_gator": ["walk*"],
            "utd_mhad": ["walk", "catch", "tennis_serve"],
            "msrc12": ["lift_outstretched_arms"],
            "bandai_namco": ["walk*", "dash", "bye*", "wave*"],
            "cad60": ["drinking_water"],
            "cmu_mocap_subset": ["*walk*"],
            "cc0_animations": [
                "walk*", "skeletons_walking", "lie_standup", "skeletons_awaken_standing",
                "waving", "thow_object", "consume_item",
            ],
        },
    ),
    "sensors 2": Fold(
        {"kinder_gator": ["*"], "utd_mhad": ["*"], "msrc12": ["*"]},
        {
            "kard": ["walk", "draw_tick"],
            "msr_action3d": ["tennis_serve", "tennis_swing", "hand_catch"],
            "ui_prmd_vicon": ["standing_straight_leg_raise"],
            "bandai_namco": ["walk*", "dash"],
            "cmu_mocap_subset": ["*walk*", "*basketball*shoot*"],
            "cc0_animations": ["walk*", "skeletons_walking", "ranged_1h_shoot*", "pistol_shoot"],
        },
    ),
}  # fmt: skip


def fold_splits(splits: Splits, fold: str) -> Splits:
    """The fold's own splits: `train` without what it holds back, which becomes `benchmark`."""

    def split(name: str, given: Split) -> Split:
        held = tuple(label for label in given.train if _named(FOLDS[fold].held, name, label))
        kept = tuple(
            label
            for label in given.train
            if label not in held and not _named(FOLDS[fold].alike, name, label)
        )
        return Split(kept, held, ())

    each = {name: split(name, given) for name, given in splits.by_collection.items()}
    return Splits(f"{splits.source}, fold {fold}", each)


def read_folder(folder: Path, splits: Path) -> tuple[dict[str, Collection], Splits]:
    """All collections of a folder by name, and the splits."""
    collections = {path.stem: read_collection(path) for path in sorted(folder.glob("*.npz"))}
    return collections, read_splits(splits)


def thinned(collection: Collection, clips: int) -> Collection:
    """The first `clips` of each performer in each class: more add time, not certainty."""
    count: Counter[tuple[str, str]] = Counter()
    kept = []
    for clip, shown in enumerate(zip(collection.labels, collection.subjects, strict=True)):
        count[shown] += 1
        if count[shown] <= clips:
            kept.append(clip)
    columns = (collection.clips, collection.labels, collection.subjects)
    shorter, labels, subjects = (tuple(column[k] for k in kept) for column in columns)
    return Collection(shorter, labels, subjects, collection.name)


def _named(patterns: Patterns, name: str, label: str) -> bool:
    return any(fnmatch(label, pattern) for pattern in patterns.get(name, ()))
