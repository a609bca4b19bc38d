"""Files and folders: outputs that appear whole, the lock on an output, where a user's own files
and the shipped weights lie, JSON of results; and all in which Linux, macOS and Windows differ."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import shlex
import signal
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Literal

from actioncli.errors import ActionCliError, UsageError, WeightsError

HOME_VARIABLE = "ACTIONCLI_HOME"
CHECKSUMS = "SHA256SUMS"
# What a file in a folder says in which the tool may delete; and a file that is not finished.
_MARK = "This folder belongs to actioncli, which deletes its {} in it.\n"
_PART = re.compile(r"\.actioncli-\w{8}\.part")
_PACKAGE = Path(__file__).resolve().parent
# What differs between systems asks this name, in whose place tests put another system's.
SYSTEM = sys.platform
# One of these says that there is a screen to show a browser on.
_SCREENS = frozenset({"DISPLAY", "WAYLAND_DISPLAY", "BROWSER"})


class NoHomeError(OSError):
    """There is no such place, as for a service whose user has no home."""


def user_folder(kind: Literal["data", "cache"]) -> Path:
    """The folder for what is kept, or for what could be made again; nothing is created.

    Raises:
        NoHomeError: the user has no home, or `ACTIONCLI_HOME` begins with that of nobody.
    """
    named = os.environ.get(HOME_VARIABLE)
    try:
        if named:
            return Path(named).expanduser().absolute()
        import platformdirs

        if kind == "data":
            found = platformdirs.user_data_path("actioncli", appauthor=False)
        else:
            found = platformdirs.user_cache_path("actioncli")
    except RuntimeError as error:
        if named:
            raise NoHomeError(f"{HOME_VARIABLE}={named} names no folder: {error}") from error
        found = Path()
    # Older versions of platformdirs leave `~` as it is.
    if not found.is_absolute():
        raise NoHomeError(f"This user has no home folder: let {HOME_VARIABLE} name a folder.")
    return found


def settings_file() -> Path:
    """The file in which users keep defaults, whether or not it is there.

    Raises:
        NoHomeError: as `user_folder`.
    """
    return user_folder("data") / "config.toml"


def user_settings() -> dict[str, Any]:
    """The defaults that the user set, of `SETTINGS`: in `config.toml`, or by environment variables
    such as `ACTIONCLI_TAU`, which win.

    Raises:
        UsageError: one of them is no such setting, or has an impossible value.
    """
    found: dict[str, Any] = {}
    with contextlib.suppress(NoHomeError, FileNotFoundError, NotADirectoryError):
        file = settings_file()
        with _settings_of(str(file)):
            # The package alone takes longer than most commands do without it.
            text = file.read_text("utf-8")
            import tomllib

            found = {name: _setting(name, value) for name, value in tomllib.loads(text).items()}
            if "store" in found:
                found["store"] = file.parent / found["store"]
    for name in SETTINGS:
        variable = f"ACTIONCLI_{name.upper()}"
        if os.environ.get(variable):
            with _settings_of(variable):
                found[name] = _setting(name, os.environ[variable])
    return found


@contextmanager
def _settings_of(where: str) -> Iterator[None]:
    try:
        yield
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        raise UsageError(f"{where}: cannot be read: {error.strerror}.") from error
    except (ValueError, RuntimeError) as error:
        raise UsageError(f"{where}: {error}; mend it, or take it out.") from error


def _setting(name: str, value: object) -> object:
    if name not in SETTINGS:
        raise ValueError(f"there is no setting {name!r}, only {', '.join(SETTINGS)}")
    try:
        return SETTINGS[name](value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} cannot be {value!r}") from error


def _path(value: Any) -> Path:
    return Path(value).expanduser()


def _share(value: Any) -> float:
    if not 0 <= float(value) <= 1:
        raise ValueError
    return float(value)


def _quality(value: Any) -> str:
    if value not in ("fast", "accurate"):
        raise ValueError
    return str(value)


# What users may set, and what checks it: file of the support set, pose network, threshold where
# none was calibrated, what `watch` looks at, and the broker that it sends to.
SETTINGS: Mapping[str, Callable[[Any], object]] = MappingProxyType(
    {"store": _path, "quality": _quality, "tau": _share, "camera": str, "mqtt": str}
)


def is_own_folder(folder: Path) -> bool:
    """Whether it is a folder that no other user laid there, nor a link to some other place.

    Raises:
        OSError: there is none.
    """
    status = folder.lstat()
    return is_mine(status) and stat.S_ISDIR(status.st_mode)


def marked_folder(folder: Path, made: Callable[[str], object] = lambda name: False) -> bool:
    """Make a folder in which the tool may delete, or see whether one that is there is such.

    It is known by its mark, a file with the folder's name inside. A folder that is new or empty
    gets it.

    Args:
        folder: private to its owner (0700) where it is new.
        made: whether the tool made a file of this name; a folder of such files alone gets the
            mark too.

    Returns:
        Whether it is the tool's; False where somebody else laid it there.

    Raises:
        OSError: it cannot be made or looked at.
    """
    # `mode` is that of the last folder only; the one above holds the support set.
    folder.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    folder.mkdir(exist_ok=True, mode=0o700)
    if not is_own_folder(folder):
        return False
    mark, content = folder / f".actioncli-{folder.name}", _MARK.format(folder.name).encode()
    names = [path.name for path in folder.iterdir()]
    # Others may be marking it, and be at work as soon as they have.
    if all(made(name) or _PART.fullmatch(name) for name in names) and not os.path.lexists(mark):
        with replacing(mark, private=True) as part:
            part.write_bytes(content)
    return mark.is_file() and not mark.is_symlink() and mark.read_bytes() == content


def _shipped(name: str) -> Path:
    # A wheel has it inside the package; in a checkout, and so in an editable install, it stands
    # beside.
    installed = _PACKAGE / name
    return installed if installed.is_dir() else _PACKAGE.parent / name


def weights_folder() -> Path:
    """The folder of the shipped weights."""
    return _shipped("weights")


def examples_folder() -> Path:
    """The folder of the shipped example clips, `action/performer.npz`."""
    return _shipped("examples")


def weights_file(name: str) -> Path:
    """The path of one shipped file, such as `trx_os.safetensors`.

    Raises:
        WeightsError: the file did not come with this installation.
    """
    path = weights_folder() / name
    if not path.is_file():
        raise WeightsError(
            f"{path} is missing: this installation of actioncli is incomplete. Install it again."
        )
    return path


def listed_checksums(file: Path) -> dict[str, str]:
    """SHA-256, hexadecimal, of the files that a `CHECKSUMS` lists, by name.

    Raises:
        OSError, ValueError: it cannot be read.
    """
    lines = file.read_text("ascii").splitlines()
    return {name: digest for digest, name in (line.split(maxsplit=1) for line in lines)}


@contextmanager
def replacing(
    path: Path,
    private: bool = False,
    suffix: str = ".part",
    failure: type[ActionCliError] | None = None,
) -> Iterator[Path]:
    """A new, empty file beside `path` that takes its place when the block ends well.

    Its name cannot be guessed and it is never one that was there: a link that another user laid
    in a shared folder is replaced, not followed.

    Args:
        path: the file to write; its folder must exist.
        private: keep the mode 0600 whatever the umask allows.
        suffix: how the new file's name ends, for libraries that go by it.
        failure: what is raised, with a message, where it cannot be written.

    Raises:
        OSError: it cannot be written, and there is no `failure`.
    """
    part: Path | None = None
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".actioncli-", suffix=suffix)
        part = Path(name)
        os.close(handle)
        yield part
        part.chmod(0o600 if private else 0o666 & ~_umask())
        part.replace(path)
    except BaseException as error:
        if part is not None:
            part.unlink(missing_ok=True)
        if failure is not None and isinstance(error, OSError):
            raise failure(f"{path}: cannot be written: {error.strerror or error}.") from error
        raise


def _umask() -> int:
    # There is no other way to ask for it.
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


@contextmanager
def output_lock(output: Path, command: str, error: type[ActionCliError]) -> Iterator[None]:
    """Keep other runs of a command from writing the same output, by a lock on `OUTPUT.lock`.

    The lock ends with the process that holds it, however that ends. Needs filelock, which the
    extra `train` brings.

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


def data_frame(content: Any, **named: Any) -> Any:
    """A table of pandas, which is no requirement.

    Raises:
        UsageError: it is not installed.
    """
    try:
        from pandas import DataFrame
    except ImportError as error:
        raise UsageError("tables need pandas: pip install pandas") from error
    return DataFrame(content, **named)


def json_text(document: object, indent: int | None = 2) -> str:
    """A document as JSON in ASCII: six significant digits, null for what is not finite."""
    return json.dumps(_finite(document), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


# What a spreadsheet takes for the beginning of a formula.
_FORMULA = frozenset("=+-@\t\r\n＝＋－＠")


def csv_cell(value: object) -> object:
    """A value for a cell that people open in a spreadsheet: labels and names come from anywhere."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"'{value}" if isinstance(value, str) and value[:1] in _FORMULA else value


def is_mine(status: os.stat_result) -> bool:
    """Whether a file is this user's; on Windows its folder says so, not the file."""
    return SYSTEM == "win32" or status.st_uid == os.geteuid()


def rights_of_others(path: Path) -> int:
    """The mode bits of group and others; 0 on Windows, where modes mean nothing."""
    return 0 if SYSTEM == "win32" else path.stat().st_mode & 0o077


def sync_folder(folder: Path) -> None:
    """What was created, renamed or deleted in a folder survives a power loss from now on."""
    if SYSTEM == "win32":
        return  # folders cannot be opened there, and the system sees to it
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def lock_bytes(file: BinaryIO, start: int, length: int) -> bool:
    """Lock a part of an open file until it is closed; False where another process has it."""
    try:
        if SYSTEM == "win32":
            msvcrt: Any = import_module("msvcrt")
            file.seek(start)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, length)
        else:
            import fcntl

            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, length, start)
    except (BlockingIOError, PermissionError):
        return False
    return True


def replace_open(part: Path, path: Path, file: BinaryIO) -> None:
    """Put `part` in the place of `path`, which is open as `file`."""
    if SYSTEM == "win32":
        file.close()  # only there it could not be replaced; elsewhere its lock stays until the end
    part.replace(path)


def own_cores() -> list[int]:
    """The processor cores that this process may use; all where the system does not tell."""
    if SYSTEM == "linux":
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def ending_signals() -> list[int]:
    """What a service is ended by, and what a terminal that is closed sends (not on Windows)."""
    names = ["SIGTERM"] if SYSTEM == "win32" else ["SIGTERM", "SIGHUP"]
    return [getattr(signal, name) for name in names]


def command_words(line: str) -> list[str]:
    """The words of a command line; on Windows a backslash is a part of a path.

    Raises:
        ValueError: a quotation does not end.
    """
    if SYSTEM == "win32":
        return [word.strip("'\"") for word in shlex.split(line, posix=False)]
    return shlex.split(line)


def has_screen() -> bool:
    """Whether a page can be shown to the user; macOS and Windows always have a screen."""
    return SYSTEM != "linux" or bool(os.environ.keys() & _SCREENS)


def listed_cameras() -> list[tuple[int, str]] | None:
    """Number and name of the cameras that the system lists; None where it does not (macOS,
    Windows)."""
    if SYSTEM != "linux":
        return None
    found = []
    for entry in Path("/sys/class/video4linux").glob("video*"):
        # A camera's other devices tell about its pictures and give none.
        with contextlib.suppress(OSError, ValueError):
            if int((entry / "index").read_text()) == 0:
                name = (entry / "name").read_text(errors="replace").strip()
                found.append((int(entry.name.removeprefix("video")), name))
    return sorted(found)
