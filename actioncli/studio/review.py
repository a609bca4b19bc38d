"""The page of `review`: what a stream showed, decided on one by one."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from actioncli.actions import Actions, decide_on
from actioncli.errors import SupportError, UsageError
from actioncli.live.recorder import Kept, kept_clips
from actioncli.studio.responses import AsciiJson, application, json_object, moving


@dataclass(eq=False)
class Review:
    """Everything behind the page.

    Attributes:
        done: how many clips were enrolled (`enroll`), made negatives (`negative`) and deleted
            (`delete`).
    """

    actions: Actions
    folder: Path
    done: Counter[str] = field(default_factory=Counter)

    def app(self) -> Starlette:
        """The page and what it asks for."""
        return application(
            "review.html",
            [
                Route("/api/waiting", self.waiting),
                Route("/api/waiting/{file}", self.clip),
                Route("/api/waiting/{file}", self.decide, methods=["POST"]),
            ],
        )

    def waiting(self, request: Request) -> Response:
        """All clips that wait, in the order of recording."""
        enrolled = self.actions.store.actions()
        return AsciiJson(
            {
                "folder": str(self.folder),
                "store": str(self.actions.store.path),
                "labels": [action.label for action in enrolled if not action.negative],
                "clips": [
                    {**kept.to_json(), "file": kept.file.name} for kept in kept_clips(self.folder)
                ],
            }
        )

    def clip(self, request: Request) -> Response:
        """A clip in motion, and an example of the action that it was taken for."""
        kept = self._kept(request)
        drawn = moving(kept.clip())
        try:
            first = self.actions.store.examples(kept.label)[0].id
            example = moving(self.actions.store.clip(first))
        except SupportError:  # the action is not enrolled any more
            example = None
        return AsciiJson({"figure": drawn, "example": example})

    async def decide(self, request: Request) -> Response:
        """Enrol a clip or not; either way it leaves the folder."""
        asked = await json_object(request)
        decision, label = asked.get("decision"), asked.get("label")
        if decision not in {"enroll", "negative", "delete"}:
            raise UsageError("A clip is enrolled, made a negative, or deleted.")
        if decision == "enroll" and not isinstance(label, str):
            raise UsageError("The request lacks `label`.")
        given = self.actions, self._kept(request), decision, label or ""
        warnings = await asyncio.to_thread(decide_on, *given)
        self.done[decision] += 1
        return AsciiJson({"warnings": warnings})

    def _kept(self, request: Request) -> Kept:
        # Only what the folder lists can be named.
        name = request.path_params["file"]
        for kept in kept_clips(self.folder):
            if kept.file.name == name:
                return kept
        raise SupportError(f"{name} is not in the folder any more.")
