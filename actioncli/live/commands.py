"""What is done at an event: a command of the user's is run, and never by a shell."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from actioncli.errors import UsageError
from actioncli.live.events import Event

# Commands that may run at once; an event that comes meanwhile is noted, and runs none.
_MOST_RUNNING = 8
_LAST_SECONDS = 5.0


@dataclass
class CommandRunner:
    """Runs the user's command for events, and never a shell."""

    line: str
    note: Callable[[str], None]
    words: list[str] = field(init=False)
    running: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        try:
            self.words = shlex.split(self.line)
        except ValueError as error:
            raise UsageError(f"--exec {self.line!r} is no command: {error}.") from error
        if not self.words or shutil.which(self.words[0]) is None:
            raise UsageError(f"--exec {self.line!r}: there is no such program.")

    def __call__(self, event: Event) -> None:
        self.running = [process for process in self.running if process.poll() is None]
        if len(self.running) >= _MOST_RUNNING:
            self.note(f"note: {_MOST_RUNNING} commands still run; not run again.")
            return
        event_variables = {
            "ACTIONCLI_LABEL": event.label,
            "ACTIONCLI_CONFIDENCE": f"{event.confidence:.3f}",
            "ACTIONCLI_START": f"{event.start:.3f}",
            "ACTIONCLI_END": f"{event.end:.3f}",
        }
        # Its output goes to standard error: standard output belongs to the events.
        environment = {**os.environ, **event_variables}
        try:
            running = subprocess.Popen(
                self.words, env=environment, stdin=subprocess.DEVNULL, stdout=2
            )
        except OSError as error:  # such as a script whose first line names no program
            self.note(f"error: --exec {self.line}: cannot be run: {error.strerror}.")
        else:
            self.running.append(running)

    def wait(self) -> None:
        """Give commands that still run a little time; they are not ended."""
        deadline = time.monotonic() + _LAST_SECONDS
        for process in self.running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(deadline - time.monotonic(), 0))
