"""Deletes a folder of uploads; as a program, once the process that started it has ended.

It runs without the packages of the environment, so it imports the standard library alone.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

# Uploads and exports, what `replacing` makes beside them, the page that opens the browser.
_MADE = re.compile(r"[0-9a-f]{32}\.\w+|\.actioncli-\w+\.\w+|open\.html")


def delete_uploads(folder: Path) -> None:
    """Delete the files of a folder that bear a name the tool gives, then the folder if it is empty.

    Links are not followed. What cannot be deleted stays.
    """
    try:
        if folder.is_symlink():
            return
        for path in folder.iterdir():
            if _MADE.fullmatch(path.name) and path.is_file() and not path.is_symlink():
                path.unlink()
        folder.rmdir()
    except OSError:
        return


if __name__ == "__main__":
    sys.stdin.read()
    delete_uploads(Path(sys.argv[1]))
