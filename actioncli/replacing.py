"""Writing a file whole or not at all, and never through somebody else's link."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path, private: bool = False, suffix: str = ".part") -> Iterator[Path]:
    """A new, empty file beside `path` that takes its place when the block ends well.

    Its name cannot be guessed and it is never one that was there: a link that another user laid
    in a shared folder is replaced, not followed.

    Args:
        path: the file to write; its folder must exist.
        private: keep the mode 0600 whatever the umask allows.
        suffix: how the new file's name ends, for libraries that go by it.

    Raises:
        OSError: it cannot be written.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".actioncli-", suffix=suffix)
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.chmod(0o600 if private else 0o666 & ~_umask())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _umask() -> int:
    # There is no other way to ask for it.
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
