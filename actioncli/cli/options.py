"""Options that more than one command takes, and the groups of those that say how to read clips."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli.cli.command import Options
from actioncli.errors import ActionCliError, UsageError
from actioncli.pose.read import ReadOptions

if TYPE_CHECKING:
    from actioncli.pose.metrabs import PoseModel


def complete_label(ctx: typer.Context, incomplete: str) -> list[str]:
    """Enrolled labels for the shell; none where there is no readable support set."""
    from actioncli.store.store import SupportStore

    given = ctx.params.get("store") or ctx.find_root().params.get("store")
    try:
        with SupportStore(given) as store:
            labels = [action.label for action in store.actions()]
    except ActionCliError:
        return []
    fitting = [label for label in labels if label.startswith(incomplete)]
    if os.environ.get("_ACTIONCLI_COMPLETE") == "complete_bash":
        # bash takes a word as it is given; the other shells' scripts quote it.
        return [re.sub(r"([^\w@%+=:,./-])", r"\\\1", label) for label in fitting]
    return fitting


def complete_layout(incomplete: str) -> list[str]:
    """Names of the skeleton layouts for the shell."""
    from actioncli.clips.skeleton import LAYOUTS

    return [name for name in LAYOUTS if name.startswith(incomplete)]


ClipArguments = Annotated[
    list[Path],
    typer.Argument(
        metavar="CLIP...",
        help="Clip files or videos, folders of them, or patterns such as 'day1/*.npy'.",
    ),
]
LayoutOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Skeleton layout of files that do not name their joints, such as smpl+head_30.",
        autocompletion=complete_layout,
    ),
]
UnitOption = Annotated[
    str | None,
    typer.Option(metavar="m|cm|mm|in", help="Unit of the files, or a number: metres per unit."),
]
UpOption = Annotated[
    str | None,
    typer.Option(metavar="AXIS", help="Axis that points up in the files, such as z or -y."),
]
FpsOption = Annotated[
    float | None, typer.Option(metavar="RATE", help="Frames per second of the files.")
]
TauOption = Annotated[
    float | None,
    typer.Option(
        metavar="0..1",
        help="Accept where the confidence is above it.  [default: the calibrated one, else 0.5]",
    ),
]
WeightsOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Weights to use instead of those that came along."),
]
StartOption = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Where the action begins in a video.  [default: found from the motion]",
    ),
]
EndOption = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Where it ends.  [default: found from the motion]"),
]
QualityOption = Annotated[
    str | None,
    typer.Option(metavar="fast|accurate", help="Pose network for videos.  [default: fast]"),
]
PersonOption = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="Whom to follow in a video, 1 is the leftmost.  [default: who moves most]"
    ),
]
CacheOption = Annotated[
    bool, typer.Option("--cache/--no-cache", help="Keep poses of videos for the next time.")
]

PoseOption = Annotated[
    str, typer.Option("--pose", metavar="blazepose|metrabs", help="Pose estimator for videos.")
]
PoseModelOption = Annotated[
    Path | None,
    typer.Option(
        "--pose-model",
        metavar="FOLDER",
        help="MeTRAbs model that you have downloaded; its weights are for non-commercial use.",
    ),
]


def file_options(
    layout: LayoutOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    fps: FpsOption = None,
) -> dict[str, Any]:
    """What files of joints leave open, as fields of `ReadOptions`."""
    return {"layout": layout, "unit": unit, "up": up, "fps": fps}


def archive_options(
    quality: QualityOption = None, person: PersonOption = None, cache: CacheOption = True
) -> dict[str, Any]:
    """How to look at any video, as fields of `ReadOptions`."""
    return {"quality": quality and checked_quality(quality), "person": person, "cache": cache}


def video_options(
    start: StartOption = None,
    end: EndOption = None,
    quality: QualityOption = None,
    person: PersonOption = None,
    cache: CacheOption = True,
    pose: PoseOption = "blazepose",
    pose_model: PoseModelOption = None,
) -> dict[str, Any]:
    """How to look at videos, as fields of `ReadOptions`."""
    model = chosen_pose_model(pose, pose_model)
    shared = archive_options(quality, person, cache)
    return {"start": start, "end": end, **shared, "metrabs": model}


FileReading = Annotated[ReadOptions, Options(ReadOptions, file_options)]
ArchiveReading = Annotated[ReadOptions, Options(ReadOptions, file_options, archive_options)]
VideoReading = Annotated[ReadOptions, Options(ReadOptions, video_options)]
ClipReading = Annotated[ReadOptions, Options(ReadOptions, file_options, video_options)]


def checked_tau(tau: float) -> float:
    """`tau` if it is a threshold.

    Raises:
        UsageError: it is not within [0, 1].
    """
    if not 0 <= tau <= 1:
        raise UsageError(f"tau must lie between 0 and 1, not {tau:g}.")
    return tau


def checked_quality(quality: str | None) -> str:
    """The quality to use.

    Raises:
        UsageError: there is no such one.
    """
    from actioncli.pose.networks import LANDMARKS
    from actioncli.pose.video import DEFAULT_QUALITY

    if quality is not None and quality not in LANDMARKS:
        raise UsageError(f"--quality is {' or '.join(LANDMARKS)}, not {quality!r}.")
    return quality or DEFAULT_QUALITY


def chosen_pose_model(pose: str, path: Path | None) -> PoseModel | None:
    """The MeTRAbs model to use; None for BlazePose.

    Raises:
        UsageError: the two options do not fit.
        WeightsError: the model cannot be loaded.
    """
    if pose not in ("blazepose", "metrabs"):
        raise UsageError(f"--pose is blazepose or metrabs, not {pose!r}.")
    if (pose == "metrabs") != (path is not None):
        raise UsageError(
            "--pose metrabs and --pose-model FOLDER belong together: the model is not part of "
            "actioncli."
        )
    if path is None:
        return None
    from actioncli.pose.metrabs import load_model

    return load_model(path)
