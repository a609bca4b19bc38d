"""The studio's page: what it can ask for, and who answers."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute

from actioncli.actions import Actions
from actioncli.clips.active import one_repetition
from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import SupportError, UsageError
from actioncli.files import examples_folder
from actioncli.pose import ReadOptions, without_password
from actioncli.recognition.threshold import Threshold, keep_threshold, rename_action
from actioncli.studio.live import live_endpoint, source_endpoint
from actioncli.studio.measure import Measurement
from actioncli.studio.responses import (
    AsciiJson,
    application,
    checked_tau,
    decision_entry,
    json_object,
    moving,
)
from actioncli.studio.upload_folder import UploadFolder, receive
from actioncli.studio.uploads import Uploads, check_kind

# Bytes of an upload: minutes of video, where seconds are wanted.
LARGEST_UPLOAD = 500_000_000
# Who performs the actions of `tour`, in the clips that came along: to begin without a camera.
SAMPLES = {
    "squat": ["ada", "ben", "cleo"],
    "wave_right": ["ada", "ben", "cleo"],
    "jumping_jack": ["ada", "ben", "dev"],
    "bow": ["ben"],
}
# What may be said about reading a file; see `ReadOptions`.
_OPTIONS = {"layout": str, "unit": str, "up": str, "fps": float, "start": float, "end": float,
            "person": int, "quality": str}  # fmt: skip


@dataclass(eq=False)
class Studio:
    """Everything behind the page; `close` it when it is no longer served.

    Attributes:
        actions: what is enrolled.
        upload_folder: where uploads lie while they are read.
        limit: bytes of an upload.
        source: a camera beside the browser's own, see `open_source`.
    """

    actions: Actions
    upload_folder: UploadFolder
    limit: int = LARGEST_UPLOAD
    source: str | None = None

    def __post_init__(self) -> None:
        self.uploads = Uploads(self.actions.recognizer)
        self.measurement = Measurement(self.actions)

    def close(self) -> None:
        """Stop what is going on; nothing is written to the private folder any more."""
        self.measurement.close()
        self.uploads.close()

    def app(self) -> Starlette:
        """The page and what it asks for."""
        return application(
            "studio.html",
            [
                Route("/api/state", self.state),
                Route("/api/examples/{id:int}", self.example_figure),
                Route("/api/examples/{id:int}", self.remove, methods=["DELETE"]),
                Route("/api/actions", self.remove, methods=["DELETE"]),
                Route("/api/actions", self.rename_action, methods=["PATCH"]),
                Route("/api/samples/{action}/{performer}", self.sample),
                Route("/api/clips", self.upload, methods=["POST"]),
                Route("/api/clips/{id}", self.clip),
                Route("/api/clips/{id}", self.discard, methods=["DELETE"]),
                Route("/api/clips/{id}/enroll", self.enroll, methods=["POST"]),
                Route("/api/measurement", self.measured),
                Route("/api/tau", self.keep_tau, methods=["PUT"]),
                Route("/api/export", self.export),
                WebSocketRoute("/api/live", live_endpoint(self.actions)),
                WebSocketRoute("/api/source", source_endpoint(self.source)),
            ],
        )

    def state(self, request: Request) -> Response:
        """What is enrolled; nothing new where the page names the version that it has."""
        version, support = self.actions.version, self.actions.support
        if request.query_params.get("version") == version:
            return AsciiJson({"version": version})
        actions: dict[str, dict[str, Any]] = {}
        for each in support.examples:
            action = {"label": each.label, "negative": each.negative, "examples": []}
            actions.setdefault(each.label, action)["examples"].append(each.to_json())
        state = {
            "version": version,
            "store": str(self.actions.store.path),
            "actions": list(actions.values()),
            "tau": support.threshold.tau,
            "kept": support.stored_threshold is support.threshold,
            "automatic": support.threshold.automatic,
            "own": len(support.threshold.actions),
            "limit": self.limit,
            "layouts": list(LAYOUTS),
            "source": self.source and without_password(self.source),
            "samples": SAMPLES,
        }
        return AsciiJson(state)

    def example_figure(self, request: Request) -> Response:
        """The skeleton of an example."""
        return AsciiJson(moving(self.actions.store.clip(request.path_params["id"])))

    def sample(self, request: Request) -> Response:
        """A clip that came along, as if the page's user had it as a file."""
        action, performer = request.path_params["action"], request.path_params["performer"]
        if performer not in SAMPLES.get(action, ()):
            raise SupportError(f"No clip {action}/{performer} came along.")
        content = (examples_folder() / action / f"{performer}.npz").read_bytes()
        return Response(content, media_type="application/octet-stream")

    async def remove(self, request: Request) -> Response:
        """Delete an action, or one of its examples."""
        label = _text(await json_object(request), "label")
        example = request.path_params.get("id")
        removed = await asyncio.to_thread(self.actions.store.remove, label, example)
        return AsciiJson({"removed": removed})

    async def rename_action(self, request: Request) -> Response:
        """Give an action another name."""
        asked = await json_object(request)
        old, new = _text(asked, "label"), _text(asked, "new")
        renamed = await asyncio.to_thread(rename_action, self.actions.store, old, new)
        return AsciiJson({"examples": renamed})

    async def upload(self, request: Request) -> Response:
        """Take a file, whose name stands in the address and whose bytes are the body."""
        name = request.query_params.get("name", "")
        suffix = check_kind(name)
        options = _options(request.query_params)
        path = await receive(request, self.upload_folder, suffix, self.limit)
        upload = self.uploads.add(path, name, options)
        return AsciiJson({"id": upload.id, "name": upload.name}, 202)

    def clip(self, request: Request) -> Response:
        """How far reading is, or the clip and what it shows."""
        upload = self.uploads.get(request.path_params["id"])
        entry: dict[str, Any] = {"id": upload.id, "name": upload.name, "state": "reading"}
        if not upload.reading.done():
            if upload.progress is not None:
                entry["seconds"] = upload.progress.seconds
                entry["total"] = upload.progress.total
            return AsciiJson(entry)
        if message := upload.error():
            return AsciiJson({**entry, "state": "failed", "message": message})
        clip = upload.clip()
        support = self.actions.support
        decision = support.classify(clip, upload.whole) if support.actions else None
        entry |= {
            "state": "ready",
            "frames": len(clip),
            "seconds": clip.duration,
            "notes": list(clip.notes),
            "figure": moving(clip),
            "decision": decision_entry(decision),
        }
        return AsciiJson(entry)

    def discard(self, request: Request) -> Response:
        """Forget a clip, or stop reading it."""
        self.uploads.discard(request.path_params["id"])
        return Response(status_code=204)

    async def enroll(self, request: Request) -> Response:
        """Keep a clip in the support set."""
        asked = await json_object(request)
        negative = asked.get("negative") is True
        label = "" if negative else _text(asked, "label")
        number = request.path_params["id"]
        upload = self.uploads.get(number)
        clip = upload.clip() if upload.whole else one_repetition(upload.clip())
        [enrolled] = await asyncio.to_thread(self.actions.enrol, label, clip, negative=negative)
        self.uploads.discard(number)
        told = {"warnings": list(enrolled.told)}
        return AsciiJson({"label": enrolled.label, **enrolled.to_json(), **told})

    def measured(self, request: Request) -> Response:
        """False accepts and rejects over tau."""
        return AsciiJson(self.measurement.state())

    async def keep_tau(self, request: Request) -> Response:
        """Use a threshold from now on, here and in the commands; null forgets it."""
        tau = checked_tau((await json_object(request)).get("tau"))
        checksum = self.actions.recognizer.weights.checksum
        threshold = None if tau is None else Threshold(tau, checksum)
        await asyncio.to_thread(keep_threshold, self.actions.store, threshold)
        return AsciiJson({"tau": tau})

    def export(self, request: Request) -> Response:
        """The support set as one file, as `export` writes it."""
        file = self.upload_folder.file(".safetensors")
        file.unlink()
        try:
            self.actions.store.export(file)
            return Response(file.read_bytes(), media_type="application/octet-stream")
        finally:
            file.unlink(missing_ok=True)


def _text(asked: dict[str, Any], key: str) -> str:
    value = asked.get(key)
    if not isinstance(value, str):
        raise UsageError(f"The request lacks `{key}`.")
    return value


def _options(given: Mapping[str, str]) -> ReadOptions:
    options: dict[str, Any] = {}
    for name, kind in _OPTIONS.items():
        if name in given:
            try:
                options[name] = kind(given[name])
            except ValueError as error:
                raise UsageError(f"{name} must be a number, not {given[name]!r}.") from error
    # What is kept, is kept in the support set: no poses in the cache.
    return ReadOptions(**options, cache=False)
