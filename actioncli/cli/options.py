"""Options that more than one command takes, and the groups of those that say how to read clips."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Literal

import typer

from actioncli.cli.command import Options
from actioncli.errors import ActionCliError, UsageError
from actioncli.pose import ReadOptions


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


def file_named(name: str) -> Path:
    """An argument as a path; an empty one, such as a variable that is not set, is none."""
    if not name:
        raise typer.BadParameter("a name is empty.")
    return Path(name)


ClipArguments = Annotated[
    list[Path],
    typer.Argument(
        metavar="CLIP...",
        help="Clip files or videos, folders of them, or patterns such as 'day1/*.mp4'.",
        parser=file_named,
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Write over a file that is there.")]
TauOption = Annotated[
    float | None,
    typer.Option(
        metavar="0..1",
        help="Accept where the confidence is above it.  [default: the calibrated one, else that of "
        "config.toml, else 0.5]",
    ),
]
WeightsOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Weights to use instead of those that came along."),
]
QualityOption = Annotated[
    Literal["fast", "accurate"] | None,
    typer.Option(
        metavar="fast|accurate",
        help="Pose network for videos.  [default: that of config.toml, else fast]",
        show_default=False,
    ),
]
HandsOption = Annotated[
    bool | None,
    typer.Option(
        "--hands/--no-hands",
        help="Look for hands in videos and cameras.  [default: where legs are out of view]",
    ),
]


def read_options(
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Skeleton layout of files that do not name their joints, such as smpl+head_30.",
            autocompletion=complete_layout,
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(metavar="m|cm|mm|in", help="Unit of the files, or a number: metres per unit."),
    ] = None,
    up: Annotated[
        str | None,
        typer.Option(metavar="AXIS", help="Axis that points up in the files, such as z or -y."),
    ] = None,
    fps: Annotated[
        float | None, typer.Option(metavar="RATE", help="Frames per second of the files.")
    ] = None,
    start: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Where the action begins in a video.  [default: found from the motion]",
        ),
    ] = None,
    end: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Where it ends.  [default: found from the motion]"),
    ] = None,
    quality: QualityOption = None,
    person: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Whom to follow in a video, 1 is the leftmost.  [default: who moves most]",
        ),
    ] = None,
    cache: Annotated[
        bool, typer.Option("--cache/--no-cache", help="Keep poses of videos for the next time.")
    ] = True,
    hands: HandsOption = None,
    pose: Annotated[
        Literal["blazepose", "metrabs"],
        typer.Option("--pose", metavar="blazepose|metrabs", help="Pose estimator for videos."),
    ] = "blazepose",
    pose_model: Annotated[
        Path | None,
        typer.Option(
            "--pose-model",
            metavar="FOLDER",
            help="MeTRAbs model that you have downloaded; its weights are for non-commercial use.",
        ),
    ] = None,
) -> ReadOptions:
    """What the options say; a command takes those that mean something to it.

    Raises:
        UsageError: two of them do not fit.
        WeightsError: the pose model cannot be loaded.
    """
    if (pose == "metrabs") != (pose_model is not None):
        raise UsageError(
            "--pose metrabs and --pose-model FOLDER belong together: the model is not part of "
            "actioncli."
        )
    if pose_model is not None:
        from actioncli.pose.metrabs import load_model

        load_model(pose_model)  # it stays loaded; one that cannot be is told before any work
    return ReadOptions(layout, fps, unit, up, start, end, quality, person, cache, hands, pose_model)


_FILE, _PERSON = "layout unit up fps", "quality person cache hands"
_VIDEO = f"start end {_PERSON} pose pose_model"
StreamReading = Annotated[ReadOptions, Options(read_options, f"{_FILE} quality hands")]
ArchiveReading = Annotated[ReadOptions, Options(read_options, f"{_FILE} {_PERSON}")]
VideoReading = Annotated[ReadOptions, Options(read_options, _VIDEO)]
ClipReading = Annotated[ReadOptions, Options(read_options, f"{_FILE} {_VIDEO}")]
