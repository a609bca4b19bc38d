"""`doctor`: whether this installation can do its work, and what is missing."""

from __future__ import annotations

import hashlib
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata, util
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli._version import __version__
from actioncli.cli.command import Settings, command
from actioncli.cli.options import WeightsOption
from actioncli.cli.output import note, plural, printable, say, table, write_json
from actioncli.errors import ActionCliError, StoreError, UsageError, WeightsError

if TYPE_CHECKING:
    from actioncli.store.repair import Repair

# Module, the package that brings it, what it is for.
_NEEDED = (
    ("numpy", "numpy", "all recognition"),
    ("safetensors", "safetensors", "reading weights"),
    ("onnxruntime", "onnxruntime", "poses from video"),
    ("cv2", "opencv-python-headless", "reading video"),
    ("typer", "typer", "the command line"),
    ("rich", "rich", "progress bars"),
)
_OPTIONAL = (
    ("PIL", "pillow", "drawings as PNG, GIF, MP4; pip install 'actioncli[report]'"),
    ("starlette", "starlette", "studio and review --page; pip install 'actioncli[studio]'"),
    ("ray", "ray", "batch --ray and Parquet; pip install 'actioncli[ray]'"),
    ("torch", "torch", "training; pip install 'actioncli[train]'"),
)

EXIT_INCOMPLETE = 70


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: what it is.
        status: `ok`, `missing` (not needed, tells what it would be for) or `problem`.
        detail: what was found.
        exit_code: what a problem with it ends the command with.
    """

    name: str
    status: str
    detail: str
    exit_code: int = 0

    def to_json(self) -> dict[str, object]:
        """As plain values, without the exit code."""
        return {"name": self.name, "status": self.status, "detail": self.detail}


@command
def doctor(
    settings: Settings,
    weights: WeightsOption = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Salvage what a damaged support set still holds.")
    ] = False,
) -> None:
    """Check this installation and the support set.

    Versions, weights, shipped files and the support set are looked at, recognition and the
    networks of body and hands are tried, and what is missing is told.

    With --repair, what a damaged support set still holds is put into a new file in its place; the
    damaged one is kept beside it, and what is gone is told. Every recording that comes back is,
    bit for bit, the one that was enrolled. JSON then has `repair`, null where nothing was damaged.

    The exit code is 0 if nothing is wrong, 6 for the weights, 5 for the support set and 70 for
    an incomplete installation. Optional parts that are missing are no error, nor is a support set
    that could be repaired.

    \b
    Examples:
      actioncli doctor
      actioncli doctor --json
      actioncli doctor --repair

    \b
    JSON keys:
      ok, checks, repair
      checks[]: name, status, detail
      repair: kept, salvaged, doubtful, gone, settings_gone, complete
      repair.gone[]: id, label, why
    """
    repaired = _repair(settings) if repair else None
    checks = [
        Check("actioncli", "ok", __version__),
        Check("python", "ok", f"{platform.python_version()} on {platform.platform()}"),
        _settings(),
        *_packages(),
        *_shipped_files(),
        *_recognition(weights),
        *_poses(),
        *_support_set(settings),
    ]
    problems = [check for check in checks if check.status == "problem"]
    if settings.json:
        outcome = {"repair": None if repaired is None else repaired.to_json()} if repair else {}
        write_json({"ok": not problems, "checks": [check.to_json() for check in checks], **outcome})
    elif shown := problems if settings.quiet else checks:
        say(table(("part", "status", "found"), [(c.name, c.status, c.detail) for c in shown]))
    if problems:
        note(f"error: {plural(len(problems), 'problem')}: {', '.join(c.name for c in problems)}")
        # Without weights nothing works at all, so they come first.
        codes = [check.exit_code for check in problems]
        raise typer.Exit(WeightsError.exit_code if WeightsError.exit_code in codes else codes[0])


def _repair(settings: Settings) -> Repair | None:
    """Repair the support set and say what became of it."""
    with settings.open_store() as store:
        done = store.repair()
    if settings.json:
        return done
    if done is None:
        settings.tell("The support set is not damaged; nothing was repaired.")
        return None
    say(
        f"support set: {plural(len(done.labels), 'example')} salvaged; the damaged file is kept as "
        f"{printable(done.kept)}"
    )
    for each in done.gone:
        say(f"gone: example {each.id} of {printable(each.label)}: {each.why}")
    for name in done.settings_gone:
        say(f"gone: the calibrated {printable(name)}; `actioncli calibrate` finds it again")
    for example in done.doubtful:
        label = printable(done.labels[example])
        say(f"changed: note, source or date of example {example} of {label}; its recording is not")
    if not done.complete:
        say("Whether more is gone cannot be told: the list of examples was damaged too.")
    return done


def _settings() -> Check:
    from actioncli.files import NoHomeError, settings_file, user_settings
    from actioncli.pose import without_password

    try:
        set_ = user_settings().items()
        found = ", ".join(f"{name} {without_password(value)}" for name, value in set_)
        return Check("settings", "ok", f"{found or 'none'} ({settings_file()}, environment)")
    except NoHomeError as error:
        return Check("settings", "ok", str(error))
    except UsageError as error:
        return Check("settings", "problem", str(error), UsageError.exit_code)


def _packages() -> Iterator[Check]:
    # Reads the list of files of everything that is installed: once is long enough.
    distributions = metadata.packages_distributions()
    for needed, packages in ((True, _NEEDED), (False, _OPTIONAL)):
        for module, package, purpose in packages:
            if util.find_spec(module) is None:
                status = "problem" if needed else "missing"
                yield Check(package, status, f"not installed; for {purpose}", EXIT_INCOMPLETE)
            else:
                # The same module can come from several packages, as cv2 does.
                names = sorted(set(distributions.get(module, ())))
                versions = ", ".join(f"{name} {metadata.version(name)}" for name in names)
                yield Check(package, "ok", versions or "version unknown")


def _shipped_files() -> Iterator[Check]:
    from actioncli.files import CHECKSUMS, listed_checksums, weights_folder

    folder = weights_folder()
    again = "install actioncli again"
    try:
        sums = listed_checksums(folder / CHECKSUMS)
    except (OSError, ValueError) as error:
        yield Check("shipped files", "problem", f"{error}; {again}", EXIT_INCOMPLETE)
        return
    for name, digest in sums.items():
        try:
            content = (folder / name).read_bytes()
        except OSError as error:
            yield Check(name, "problem", f"{error}; {again}", EXIT_INCOMPLETE)
            continue
        if hashlib.sha256(content).hexdigest() == digest:
            yield Check(name, "ok", f"{len(content) / 1e6:.1f} MB, intact")
        else:
            found = f"altered or damaged: not the file that was shipped; {again}"
            yield Check(name, "problem", found, EXIT_INCOMPLETE)


def _recognition(weights: Path | None) -> Iterator[Check]:
    """Load the weights and let them answer once."""
    import numpy as np

    from actioncli.clips.clip import Clip
    from actioncli.recognition.recognizer import Recognizer

    try:
        recognizer = Recognizer(weights)
        loaded = recognizer.weights
        recipe, seed = loaded.metadata.get("recipe"), loaded.metadata.get("seed")
        # The whole recipe is a page of settings.
        made = f"recipe {recipe.get('name')}" if isinstance(recipe, dict) else "no recipe"
        made += "" if seed is None else f", seed {seed}"
        yield Check("weights", "ok", f"{loaded.path} ({made}, {loaded.checksum[:12]})")
        names = loaded.config.preparation.joints
        joints = np.random.default_rng(0).normal(size=(20, len(names), 3))
        clip = Clip(joints, names)
        start = time.perf_counter()
        recognizer.compare([clip], {"itself": [clip]})
        yield Check("recognition", "ok", f"answers in {(time.perf_counter() - start) * 1e3:.0f} ms")
    except ActionCliError as error:
        yield Check("weights", "problem", str(error), WeightsError.exit_code)


def _poses() -> Iterator[Check]:
    """Load what videos need, and let the networks of body and hands look at a picture."""
    import numpy as np

    try:
        from actioncli.pose.estimator import Estimator
        from actioncli.pose.hands import HandEstimator
        from actioncli.pose.landmarks import SIDE, LandmarkEstimator
        from actioncli.pose.region import Region

        picture, middle = np.zeros((SIDE, SIDE, 3), np.uint8), Region(SIDE / 2, SIDE / 2, SIDE)
        looks: dict[str, Estimator[Any]] = {
            "poses": LandmarkEstimator("fast"),
            "hands": HandEstimator(),
        }
        for name, look in looks.items():
            start = time.perf_counter()
            look(picture, middle)
            yield Check(name, "ok", f"answers in {(time.perf_counter() - start) * 1e3:.0f} ms")
    # Libraries of the system that are missing, or older ones, report it in many ways.
    except Exception as error:  # noqa: BLE001
        message = " ".join(str(error).split())
        yield Check("poses", "problem", f"no video can be read: {message}", EXIT_INCOMPLETE)


def _support_set(settings: Settings) -> Iterator[Check]:
    try:
        with settings.open_store() as store:
            yield Check("support set", "ok", str(store.path))
            problems = store.check()
            actions = store.actions()
            copy = store.backup_flaw()
    except (StoreError, UsageError) as error:
        yield Check("support set", "problem", str(error), error.exit_code)
        return
    for problem in problems:
        yield Check("support set", "problem", problem, StoreError.exit_code)
    if actions:
        yield Check("copy of it", "missing" if copy else "ok", copy or "as it is now, and whole")
    examples = sum(action.examples for action in actions)
    yield Check(
        "enrolled", "ok", f"{plural(len(actions), 'action')}, {plural(examples, 'example')}"
    )
