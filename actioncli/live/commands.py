"""A command of the user's is run at events, and never by a shell."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from actioncli.errors import UsageError
from actioncli.files import command_words
from actioncli.live.events import Event
from actioncli.live.reactions import LAST_SECONDS, Reaction

# Commands that may run at once; an event that comes meanwhile is noted, and runs none.
_MOST_RUNNING = 8


@dataclass
class CommandRunner(Reaction):
    """Runs the user's command for events, and never a shell.

    Attributes:
        line: the command.
        note: hears what a person should know.
        show: hears each line that a command writes; None lets it write to standard error itself.
    """

    line: str
    note: Callable[[str], None]
    show: Callable[[str], None] | None = None
    words: list[str] = field(init=False)
    running: list[subprocess.Popen[bytes]] = field(default_factory=list)
    _reading: list[threading.Thread] = field(default_factory=list)

    def __post_init__(self) -> None:
        try:
            self.words = command_words(self.line)
        except ValueError as error:
            raise UsageError(f"--exec {self.line!r} is no command: {error}.") from error
        if not self.words or shutil.which(self.words[0]) is None:
            there = bool(self.words) and Path(self.words[0]).is_file()
            why = "it may not be run; `chmod +x` lets it" if there else "there is no such program"
            raise UsageError(f"--exec {self.line!r}: {why}.")

    def __call__(self, event: Event) -> None:
        """Run it; its output goes to standard error, which does not belong to the events."""
        self.running = [process for process in self.running if process.poll() is None]
        self._reading = [thread for thread in self._reading if thread.is_alive()]
        if len(self.running) >= _MOST_RUNNING:
            self.note(f"note: {_MOST_RUNNING} commands still run; not run again.")
            return
        event_variables = {
            "ACTIONCLI_LABEL": event.label,
            "ACTIONCLI_CONFIDENCE": f"{event.confidence:.3f}",
            "ACTIONCLI_START": f"{event.start:.3f}",
            "ACTIONCLI_END": f"{event.end:.3f}",
        }
        environment = {**os.environ, **event_variables}
        output = (2, None) if self.show is None else (subprocess.PIPE, subprocess.STDOUT)
        nothing = subprocess.DEVNULL
        try:
            running = subprocess.Popen(
                self.words, env=environment, stdin=nothing, stdout=output[0], stderr=output[1]
            )
        except OSError as error:  # such as a script whose first line names no program
            self.note(f"error: --exec {self.line}: cannot be run: {error.strerror}.")
        else:
            self.running.append(running)
            if running.stdout is not None:
                thread = threading.Thread(target=self._read, args=(running.stdout,), daemon=True)
                thread.start()
                self._reading.append(thread)

    def _read(self, output: IO[bytes]) -> None:
        assert self.show is not None
        with output:
            for line in output:
                self.show(line.decode(errors="replace").rstrip())

    def close(self) -> None:
        """Give commands that still run a little time; they are not ended."""
        deadline = time.monotonic() + LAST_SECONDS
        for process in self.running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(deadline - time.monotonic(), 0))
        for thread in self._reading:
            thread.join(max(deadline - time.monotonic(), 0))
