"""Ray: a cluster that is there, or processes of this machine alone that leave nothing behind.

Needs the extra `ray`.
"""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from actioncli.errors import UsageError

# Bytes for what workers hand over; rows are small, and Ray wants no less.
_OBJECT_STORE = 80 * 2**20

# How long a cluster may take to answer.
_ANSWER_SECONDS = 10.0

# Nothing is reported to anyone, and Ray writes to neither standard output nor error.
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_BACKEND_LOG_LEVEL": "fatal",
    "RAY_DEDUP_LOGS": "1",
    "RAY_DEDUP_LOGS_SKIP_REGEX": ".",
}
# Ray of this machine alone: nothing listens on another interface, or to who has no token.
_PRIVATE = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # where this is off, 127.0.0.1 is its address
    "RAY_AUTH_MODE": "token",
}
# A process that removes a folder when this one ends, however it ends: Ray's last processes still
# write for a moment.
_SWEEP = """
import os, shutil, sys, time
sys.stdin.read()
for _ in range(100):
    shutil.rmtree(sys.argv[1], ignore_errors=True)
    if not os.path.exists(sys.argv[1]):
        break
    time.sleep(0.1)
"""


@contextlib.contextmanager
def joined_ray(address: str | None = None) -> Iterator[None]:
    """Ray to work on: a cluster, or processes of this machine that end with the block.

    The latter listen on the loopback interface alone, to who has a token that no other user
    knows, and keep their files in a folder of their own. They and their files are gone at the
    end, even if this process is killed; then two of Ray's agents, which do no work, take up to a
    minute to notice. To be called before Ray is imported.

    Args:
        address: of a cluster that this machine belongs to, HOST:PORT or `auto`.

    Raises:
        UsageError: there is no such cluster, or Ray does not start.
    """
    if address is not None:
        _look_for(address)
        os.environ |= _QUIET
        with _connected({"address": address}):
            yield
        return
    os.environ |= {**_QUIET, **_PRIVATE, "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    with (
        _private_folder() as folder,
        _connected(
            {
                "address": "local",
                "include_dashboard": False,
                "object_store_memory": _OBJECT_STORE,
                "_temp_dir": str(folder),
            }
        ),
    ):
        yield


@contextlib.contextmanager
def _private_folder() -> Iterator[Path]:
    """A folder that others cannot look into, and that goes away when this process ends."""
    # Sockets lie in it, whose paths may have about a hundred characters.
    short = Path("/tmp")
    folder = tempfile.mkdtemp(prefix="actioncli-", dir=short if short.is_dir() else None)
    # In a session of its own, it is not ended by Ctrl-C.
    sweeper = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _SWEEP, folder],
        stdin=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        # Ray opens its folder to all users, but not the one above.
        yield Path(folder, "ray")
    finally:
        sweeper.communicate()


@contextlib.contextmanager
def _connected(how: Mapping[str, Any]) -> Iterator[None]:
    import ray

    try:
        _start(how)
        context = ray.data.DataContext.get_current()
        # A block that is given up ends no archive; see `decide`.
        context.max_errored_blocks = -1
        # Every row comes back when it is there, not when there are megabytes of them.
        context.target_max_block_size = 1
        context.enable_progress_bars = False
        context.print_on_execution_start = False
        logging.getLogger("ray.data").setLevel(logging.CRITICAL)
        yield
    finally:
        ray.shutdown()


def _look_for(address: str) -> None:
    """Ray itself would wait for minutes for a machine that does not answer."""
    host, _, port = address.rpartition(":")
    try:
        if address != "auto":
            socket.create_connection((host, int(port)), timeout=_ANSWER_SECONDS).close()
    except (OSError, ValueError, OverflowError) as error:
        raise UsageError(
            f"there is no Ray cluster at {address!r}: start one with `ray start`, or leave out "
            "--ray."
        ) from error


def _start(how: Mapping[str, Any]) -> None:
    import ray

    try:
        with _mute():
            ray.init(**how, logging_level=logging.CRITICAL, log_to_driver=False)
    except UnicodeError as error:
        # It takes note of both, in UTF-8.
        raise UsageError(
            "Ray does not start where the command line, or the folder it is typed in, has a name "
            "that is no UTF-8; rename it, or go by a link to it."
        ) from error
    # Ray raises Exception itself where its processes are not up within half a minute, and
    # ConnectionError where `auto` finds no cluster.
    except Exception as error:
        raise UsageError(
            f"Ray does not start: {error} (try again when the machine is less busy, or with --ray "
            "on a cluster that runs)."
        ) from error


@contextlib.contextmanager
def _mute() -> Iterator[None]:
    """Keep off standard error what Ray writes past Python: that it heeds its log level."""
    before = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
