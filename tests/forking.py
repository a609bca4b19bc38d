"""Processes in need: to be killed, to run without root's rights, or to run out of space."""

import os
import resource
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

NOBODY = 65534


def fork(work: Callable[[], object], ordinary: bool = False, limit: bool = False) -> int:
    """Run `work` in a child process and return its id; the child ends with 0 if `work` did.

    Args:
        work: what to do.
        ordinary: give up root's rights first, which no permission would stop.
        limit: let no file grow beyond 300 kB, as on a full disk.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        # Newer Pythons warn where the parent has threads; the child here touches none.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child:
        return child
    code = 1
    try:
        if limit:
            resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
        if ordinary and os.geteuid() == 0:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        work()
        code = 0
    except BaseException:  # noqa: BLE001 - the child must end here, and say why
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond so many bytes, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
