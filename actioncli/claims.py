"""One process at a time writes an output that takes long."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from actioncli.errors import ActionCliError


@contextlib.contextmanager
def claimed(output: Path, command: str, error: type[ActionCliError]) -> Iterator[None]:
    """Keep other runs of a command from writing the same output, by a lock on `OUTPUT.lock`.

    The lock ends with the process that holds it, however that ends. Needs filelock, which the
    extras `train` and `ray` bring.

    Args:
        output: what is written.
        command: its name, for the message.
        error: what is raised.

    Raises:
        ActionCliError: of the class `error`: another run holds the output, or its folder cannot
            be written.
    """
    from filelock import FileLock, Timeout

    path = output.with_name(output.name + ".lock")
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout as held:
        raise error(
            f"{output}: another run of `{command}` is writing it; wait for that one, or name "
            "another output."
        ) from held
    except OSError as failed:
        raise error(f"{path}: cannot be written: {failed.strerror}.") from failed
    try:
        yield
    finally:
        # While it is still held: who waits for this file notices that it is gone.
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()
