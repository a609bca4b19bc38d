"""Rounds of faults: processes use a store while it is made hard for them; then it is looked at.

    python tests/faults/rounds.py SEED...           repeat rounds
    python tests/faults/rounds.py --from 0 --to 99  many of them, and what they did

After a round the store must be whole, hold all that was acknowledged, and nothing of what was
not, except the one thing that a killed process was about to do, which is there whole or not at all.
"""

import argparse
import ctypes
import json
import os
import random
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from worker import State, Task, Worker, checksum, make_clip

from actioncli import read_clip
from actioncli.errors import StoreError
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold
from actioncli.store.archive import read_archive
from actioncli.store.backup import backup_path, make_backup
from actioncli.store.record import Record
from actioncli.store.store import Example, SupportStore
from tests.forking import NOBODY, fork

EXAMPLES = {
    f"{file.parent.name} {file.stem}": file
    for file in sorted((Path(__file__).parents[2] / "examples").glob("*/*.npz"))
}
NAMES = (
    "support.db", "a store with spaces.db", "Unterstützung – 手 ✋.db", "x" * 244 + ".db",
    "quote' \" % # ?mode=memory.db", "-rf.db", "new\nline.db",
)  # fmt: skip
_CLONE_NEWNS, _CLONE_NEWUSER = 0x20000, 0x10000000
_MS_REC, _MS_PRIVATE = 0x4000, 0x40000


@dataclass
class Report:
    """What a worker said: the state that stands, and the one that may have come to be."""

    task: Task
    process: int
    state: State
    tau: float | None
    pending: tuple[str, State, float | None] | None = None
    begun: int = 0
    exports: dict[int, State] = field(default_factory=dict)
    done: Counter[str] = field(default_factory=Counter)
    errors: list[str] = field(default_factory=list)
    killed: bool = False

    def hear(self, line: bytes) -> None:
        """Take in one line."""
        word, *rest = json.loads(line)
        if word == "begin":
            what, state, tau = rest
            self.pending = (what, state, tau)
            self.begun += 1
            return
        assert self.pending is not None
        what, state, tau = self.pending
        self.pending = None
        if word == "error":
            self.errors.append(rest[0])
            self.done["refused"] += 1
            return
        self.state, self.tau = state, tau
        kind, _, number = what.partition(" ")
        self.done[kind] += 1
        if number:
            self.exports[int(number)] = state


class Round:
    """One round in a folder of its own; everything in it follows from the seed but the timing."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.seed = seed
        self.random = random.Random(seed)
        self.folder = folder
        self.shim = shim()
        kinds = list(KINDS)
        if self.shim is None:
            kinds = [kind for kind in kinds if kind not in {"clock", "locks"}]
        self.kind = self.random.choices(kinds, [KINDS[kind][0] for kind in kinds])[0]
        self.disk = folder / "disk"
        self.disk.mkdir()
        self.home = self.disk / self.random.choice(["home", "my actions", "Übungen ✋", "y" * 200])
        name = self.random.choice(NAMES)
        # SQLite takes no longer paths.
        fits = len(os.fsencode(self.home / name)) <= 490
        self.store = SupportStore(self.home / (name if fits else NAMES[0]))
        self.workers: list[Report] = []
        self.pipes: dict[int, tuple[Report, bytearray]] = {}
        self.selector = selectors.DefaultSelector()
        self.initial: State = {}
        self.tau: float | None = 0.0
        self.refusals = False

    def run(self) -> str:
        """Play it; a line about what happened.

        Raises:
            AssertionError: a promise was not kept.
        """
        KINDS[self.kind][1](self)
        self.finish()
        self.verify()
        done = sum((report.done for report in self.workers), Counter[str]())
        killed = sum(report.killed for report in self.workers)
        what = ", ".join(f"{count} {kind}" for kind, count in sorted(done.items()))
        return f"{self.kind}: {len(self.workers)} processes, {killed} killed; {what}"

    # What happens.

    def kill(self) -> None:
        """A few processes, each killed at a random moment of what it does."""
        self.fill_or_not()
        for turn in range(self.random.randint(2, 4)):
            count = self.random.choice([1, 1, 2, 3])
            # Only one that is alone may change the threshold.
            tau = self.tau if count == 1 else None
            for place in range(count):
                self.start(f"{turn}-{place}", steps=50, tau=tau)
            for report in self.workers[-count:]:
                self.kill_one(report)
            self.finish()

    def crowd(self) -> None:
        """Sixteen processes at once; some of them are killed."""
        self.fill_or_not()
        for place in range(16):
            self.start(f"{place}", steps=self.random.randint(2, 4))
        for report in self.random.sample(self.workers, self.random.choice([0, 4, 8])):
            self.kill_one(report)

    def full(self) -> None:
        """A disk that is too small, and on which room is made at some time."""
        self.refusals = True
        mounted = mount(self.disk, self.random.randrange(200, 700) * 1024)
        self.fill()
        ballast = self.disk / "ballast"
        if mounted:
            ballast.write_bytes(bytes(self.random.randrange(32, 100) * 1024))
        for place in range(2):
            self.start(
                f"{place}", steps=25, frames=self.random.choice([30, 200]), limit=not mounted
            )
        if self.random.random() < 0.5:
            self.listen(lambda: self.workers[0].begun >= 15)
            ballast.unlink(missing_ok=True)
        if self.random.random() < 0.3:
            self.kill_one(self.workers[0])
        self.finish()
        ballast.unlink(missing_ok=True)

    def readonly(self) -> None:
        """A folder or a file that may only be read."""
        self.refusals = True
        self.fill()
        self.give_away()
        folder, file = self.random.choice([(0o500, 0o400), (0o500, 0o600), (0o700, 0o400)])
        closed = self.store.path.read_bytes()
        self.store.path.chmod(file)
        self.home.chmod(folder)
        for place in range(2):
            self.start(f"{place}", steps=6, ordinary=True, folder=self.folder)
        self.finish()
        changed = folder == 0o500 and self.store.path.read_bytes() != closed
        assert not changed, "a store in a read-only folder was changed"
        self.open_again()

    def permissions(self) -> None:
        """Rights on file and folder come and go while processes work."""
        self.refusals = True
        self.fill()
        self.give_away()
        for place in range(2):
            self.start(f"{place}", steps=25, ordinary=True)
        for _ in range(self.random.randint(5, 15)):
            path = self.random.choice([self.home, self.store.path])
            mode = self.random.choice([0o000, 0o400, 0o500, 0o700, 0o700])
            path.chmod(mode)
            pause = self.random.uniform(0, 0.01)
            self.listen(lambda: False, pause)
            if self.random.random() < 0.5:
                self.open_again()
        if self.random.random() < 0.3:
            self.kill_one(self.workers[0])
        self.open_again()
        self.finish()

    def clock(self) -> None:
        """A clock that is somewhere else at every look."""
        self.fill()
        for place in range(2):
            self.start(f"{place}", steps=15, environment={"FAULT_CLOCK": "1"})
        if self.random.random() < 0.5:
            self.kill_one(self.workers[0])

    def locks(self) -> None:
        """A file system that refuses locks: always, or now and then."""
        import errno

        self.refusals = True
        self.fill()
        numbers = [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EIO]
        percent = self.random.choice([100, 30, 5])
        rule = f"{self.random.choice(numbers)}/{percent}"
        for place in range(2):
            self.start(f"{place}", steps=10, environment={"FAULT_LOCKS": rule}, patience=0.2)
        self.finish()
        done = {what for report in self.workers for what in report.done}
        assert percent < 100 or done <= {"refused"}, "something was done without a lock"

    def repair(self) -> None:
        """A damaged store is repaired by processes that are killed. Without a copy, a recording is
        damaged and others still use the store; with one, anything may be."""
        self.refusals = True
        self.fill()
        self.store.enroll("lost", make_clip(self.seed * 100_000, 60))
        copied = self.random.random() < 0.5
        if copied:
            self.start("0", steps=10)
            self.finish()
            assert make_backup(self.store.path), "a whole store was not copied"
        content = bytearray(self.store.path.read_bytes())
        joints = make_clip(self.seed * 100_000, 60).joints.astype("<f4").tobytes()
        content[content.index(joints[-500:])] ^= 1 << self.random.randrange(8)
        if copied:
            self.damage(content)
        self.store.path.write_bytes(content)
        if not copied:
            self.start("0", steps=10)
        for _ in range(self.random.randint(1, 4)):
            process = fork(lambda: self.store.repair())
            self.listen(lambda: False, self.random.uniform(0, 0.03))
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
        self.finish()
        done = self.store.repair()
        # The longest names lose their end, so that what is appended fits.
        [kept, *_] = sorted(self.home.glob("*.damaged"))
        assert not copied or kept.read_bytes() == content, "the damaged file was not kept"
        lost = [] if copied else [(4, "lost")]
        assert not done or [(gone.id, gone.label) for gone in done.gone] == lost, done.gone
        if copied:  # also where a repair that was killed had done its work
            self.store.remove("lost")
        left = list(self.home.glob(".repair-*"))
        assert not done or not left, f"left behind: {left}"

    def damage(self, content: bytearray) -> None:
        """Bits, pages or the end of a store's file become something else."""
        kind = self.random.choice(["bits", "zeros", "junk", "cut"])
        for _ in range(self.random.randint(1, 5)):
            at = self.random.randrange(len(content))
            page = slice(at - at % 4096, at - at % 4096 + 4096)
            if kind == "bits":
                content[at] ^= 1 << self.random.randrange(8)
            elif kind == "cut":
                del content[max(at, 1) :]
                return
            else:
                size = len(content[page])
                content[page] = bytes(size) if kind == "zeros" else self.random.randbytes(size)

    def cli(self) -> None:
        """The program itself, one command after the other, some of them killed."""
        self.refusals = True
        self.home.mkdir()
        report = Report(Task("cli", self.seed, str(self.store.path), "", 0), 0, {}, None)
        clips = {name: read_clip(file) for name, file in EXAMPLES.items()}
        contents = {name: Record.from_clip("x", clip).checksum for name, clip in clips.items()}
        state: dict[str, list[str]] = {}
        usual = 0.0
        for number in range(self.random.randint(4, 7)):
            after = {label: list(held) for label, held in state.items()}
            kind = self.random.choice(["enroll", "enroll", "rename", "remove", "export", "clear"])
            if kind == "enroll" or not state:
                label = f"action {number}"
                names = self.random.sample(sorted(clips), self.random.randint(1, 2))
                after[label] = names
                files = (str(EXAMPLES[name]) for name in names)
                words = ["enroll", label, *files, "--keep-tau"]
            elif kind == "rename":
                old = self.random.choice(sorted(state))
                after[f"action {number}"] = after.pop(old)
                words = ["rename", old, f"action {number}"]
            elif kind == "remove":
                label = self.random.choice(sorted(state))
                del after[label]
                words = ["remove", label, "--yes"]
            elif kind == "clear":
                after = {}
                words = ["clear", "--yes"]
            else:
                words = ["export", str(self.home / f"export {number}")]
            command = [sys.executable, "-m", "actioncli", "--store", str(self.store.path), *words]
            process = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=self.folder
            )
            start = time.monotonic()
            # The first one tells how long a command takes here.
            if number and self.random.random() < 0.6:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(self.random.uniform(0.5, 1.1) * usual)
                process.kill()
            error = process.communicate()[1].decode()
            usual = usual if number else time.monotonic() - start
            assert process.returncode in {0, -signal.SIGKILL}, f"{words}: {error}"
            held = by_label(self.store.examples())
            possible = [
                {label: [contents[name] for name in names] for label, names in each.items()}
                for each in ([after] if process.returncode == 0 else [state, after])
            ]
            assert held in possible, f"after {words} ({process.returncode}) there is {held}"
            state = after if held == possible[-1] else state
            report.done["killed" if process.returncode else words[0]] += 1
            if words[0] == "export" and (process.returncode == 0 or Path(words[1]).exists()):
                exported = {record.label for record in read_archive(Path(words[1]))}
                assert exported == state.keys(), f"the export holds {exported}"
        # What follows looks for the labels of workers only.
        if state:
            self.store.clear()
        self.workers.append(report)

    # The parts that these are made of.

    def fill(self) -> None:
        """Something is there already, which nobody touches; and a threshold."""
        numbers = [self.seed * 100_000 + place for place in range(1, 4)]
        self.initial = {"there before": numbers}
        self.store.enroll_all([("there before", make_clip(each, 6)) for each in numbers])
        keep_threshold(self.store, Threshold(0.5, "w"))
        self.tau = 0.5

    def fill_or_not(self) -> None:
        """Or the processes are the first ones, and make folder, file and tables."""
        if self.random.random() < 0.5:
            self.fill()

    def start(
        self,
        name: str,
        steps: int,
        *,
        frames: int = 6,
        tau: float | None = None,
        ordinary: bool = False,
        folder: Path | None = None,
        environment: dict[str, str] | None = None,
        patience: float = 60.0,
        limit: bool = False,
    ) -> None:
        """Begin a process."""
        place = folder or self.home
        task = Task(name, self.seed, str(self.store.path), str(place), steps, frames, patience, tau)
        receive, send = os.pipe()
        if environment is None:
            child = fork(lambda: Worker(task, send).run(), ordinary, limit)
        else:
            settings = {"FAULT_SEED": str(self.seed), "LD_PRELOAD": str(self.shim), **environment}
            words = [
                sys.executable,
                str(Path(__file__).with_name("worker.py")),
                json.dumps(asdict(task)),
            ]
            child = os.posix_spawn(
                words[0], words, {**os.environ, **settings},
                file_actions=[(os.POSIX_SPAWN_DUP2, send, 1)],
            )  # fmt: skip
        os.close(send)
        report = Report(task, child, {}, tau)
        self.workers.append(report)
        self.pipes[receive] = (report, bytearray())
        self.selector.register(receive, selectors.EVENT_READ)

    def listen(self, enough: Callable[[], bool], seconds: float = 900.0) -> None:
        """Hear what the workers say until it is enough, or all have ended, or time is over."""
        end = time.monotonic() + seconds
        while self.pipes and not enough() and (left := end - time.monotonic()) > 0:
            for key, _ in self.selector.select(left):
                report, rest = self.pipes[key.fd]
                part = os.read(key.fd, 65536)
                rest += part
                *lines, tail = bytes(rest).split(b"\n")
                for line in lines:
                    report.hear(line)
                rest[:] = tail
                if not part:
                    self.selector.unregister(key.fd)
                    os.close(key.fd)
                    del self.pipes[key.fd]

    def kill_one(self, report: Report) -> None:
        """Kill a process after it has begun something, at any moment of that."""
        begun = report.begun + self.random.randint(1, 6)
        self.listen(lambda: report.begun >= begun or report not in self.talking())
        time.sleep(self.random.uniform(0, self.random.choice([0.0005, 0.003, 0.01])))
        os.kill(report.process, signal.SIGKILL)
        report.killed = True

    def talking(self) -> list[Report]:
        """The workers that have not ended."""
        return [report for report, _ in self.pipes.values()]

    def finish(self) -> None:
        """Wait until all processes have ended."""
        self.listen(lambda: False)
        for report in self.workers:
            if report.process == 0:
                continue
            if report in self.talking():
                os.kill(report.process, signal.SIGKILL)
                raise AssertionError(f"worker {report.task.name} did not end: {report.pending}")
            code = os.waitstatus_to_exitcode(os.waitpid(report.process, 0)[1])
            report.process = 0
            ended = code == 0 or (report.killed and code == -signal.SIGKILL)
            assert ended, f"worker {report.task.name} ended with {code} at {report.pending}"
            report.killed = code != 0
            refused = report.errors and not self.refusals
            assert not refused, f"worker {report.task.name} was refused: {report.errors}"
            if report.tau is not None:
                self.tau = self.tau_after(report)

    def tau_after(self, report: Report) -> float | None:
        """The threshold as it stands; a pending one was kept or not."""
        kept = kept_threshold(self.store)
        found = kept.tau if kept else 0.0
        possible = {report.tau, report.pending[2] if report.pending else report.tau}
        assert found in possible, f"the threshold is {found}, not one of {possible}"
        return found

    def give_away(self) -> None:
        """Let the processes be those of an ordinary user, whom permissions bind."""
        if os.geteuid() == 0:
            for path in (self.folder, self.disk, self.home, self.store.path):
                os.chown(path, NOBODY, NOBODY)

    def open_again(self) -> None:
        """All rights are back."""
        self.home.chmod(0o700)
        self.store.path.chmod(0o600)

    # What must be true afterwards.

    def verify(self) -> None:
        """Look at everything."""
        problems = self.store.check()
        assert not problems, f"the store is damaged: {problems}"
        held = by_label(self.store.examples())
        for label, clips in self.store.support().items():
            assert len(clips) == len(held[label]), f"{label}: {len(clips)} clips"
        there = by_label(self.store.examples(), tuple(self.initial))
        assert there == sums(self.initial, 6), f"of {self.initial} there is {held}"
        for report in self.workers:
            name, frames = f"{report.task.name} ", report.task.frames
            mine = by_label(self.store.examples(), name)
            states = [report.state, *([report.pending[1]] if report.pending else [])]
            assert any(sums(state, frames) == mine for state in states), (
                f"worker {name} has {mine}, acknowledged was {report.state}, begun {report.pending}"
            )
            # An export that was acknowledged is there, is whole, and holds what was there.
            for number, state in report.exports.items():
                file = Path(report.task.folder) / f"{name}{number}.safetensors"
                mine = by_label(read_archive(file), name)
                assert sums(state, frames) == mine, f"{file.name} holds {mine}, not {state}"
            for file in Path(report.task.folder).glob(f"{name}*.safetensors"):
                list(read_archive(file))
        names = (*(f"{report.task.name} " for report in self.workers), *self.initial)
        nobodys = [label for label in held if not label.startswith(names)]
        assert not nobodys, f"labels of nobody: {nobodys}"
        copy = SupportStore(backup_path(self.store.path))
        kept = copy.path.is_file() and kept_threshold(copy)
        assert kept_threshold(self.store) or not kept, "the copy holds a forgotten threshold"
        for path, mode in ((self.store.path, 0o600), (self.home, 0o700)):
            private = not path.exists() or path.stat().st_mode & 0o777 == mode
            assert private, f"others may read {path}"
        journal = self.store.path.with_name(self.store.path.name + "-journal")
        # One that was not begun is no journal yet; the next write begins it anew.
        begun = journal.exists() and journal.read_bytes()[:1] not in {b"", b"\0"}
        assert not begun, "a journal was left"


def by_label(
    examples: Iterable[Example | Record], begins: str | tuple[str, ...] = ""
) -> dict[str, list[str]]:
    """The checksums of examples whose labels begin so, in order."""
    held: dict[str, list[str]] = {}
    for each in examples:
        if each.label.startswith(begins):
            held.setdefault(each.label, []).append(each.checksum)
    return held


def sums(state: State, frames: int) -> dict[str, list[str]]:
    """The checksums of the clips of a state."""
    return {label: [checksum(each, frames) for each in held] for label, held in state.items()}


KINDS: dict[str, tuple[int, Callable[[Round], None]]] = {
    "kill": (36, Round.kill),
    "crowd": (8, Round.crowd),
    "full": (16, Round.full),
    "readonly": (8, Round.readonly),
    "permissions": (16, Round.permissions),
    "clock": (8, Round.clock),
    "locks": (8, Round.locks),
    "repair": (8, Round.repair),
    "cli": (5, Round.cli),
}


def shim() -> Path | None:
    """The library that refuses locks and moves the clock; None without a C compiler."""
    built = Path(tempfile.gettempdir()) / f"actioncli-faults-{os.geteuid()}.so"
    source = Path(__file__).with_name("shim.c")
    if built.exists() and built.stat().st_mtime > source.stat().st_mtime:
        return built
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    fresh = built.with_suffix(f".{os.getpid()}")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", fresh, source, "-ldl"], check=True)
    fresh.chmod(0o755)
    fresh.replace(built)
    return built


def private_mounts() -> bool:
    """Give this process a view of the file systems of its own, where that is allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    user, group = os.geteuid(), os.getegid()
    if libc.unshare(_CLONE_NEWNS | (0 if user == 0 else _CLONE_NEWUSER)) != 0:
        return False
    if user != 0:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    return libc.mount(b"none", b"/", None, _MS_REC | _MS_PRIVATE, None) == 0


def mount(folder: Path, size: int) -> bool:
    """Put a file system in memory on a folder; whether that was possible."""
    libc = ctypes.CDLL(None, use_errno=True)
    options = f"size={size},mode=711".encode()
    return libc.mount(b"none", os.fsencode(folder), b"tmpfs", 0, options) == 0


def play(seed: int) -> tuple[bool, str]:
    """Play one round in a process of its own; whether all is well, and what happened."""
    base = Path(tempfile.mkdtemp(prefix="actioncli-faults-"))
    base.chmod(0o711)
    receive, send = os.pipe()

    def arena() -> None:
        os.close(receive)
        os.umask(0)
        # As root the disk is in memory for every round, which makes syncing quick. Others may
        # mount only by giving up the difference between users, which the permissions need.
        ordinary = os.geteuid() != 0
        rehearsal = Round(seed, Path(tempfile.mkdtemp(dir=base)))
        bound = ordinary and rehearsal.kind in {"readonly", "permissions"}
        inside = base / "round"
        inside.mkdir()
        if not bound and private_mounts():
            mount(inside, 64 * 2**20)
        try:
            os.write(send, Round(seed, inside).run().encode())
        except (StoreError, AssertionError) as error:
            message = f"{rehearsal.kind}: {type(error).__name__}: {error}"
            os.write(send, message.encode()[:60_000])
            raise

    child = fork(arena)
    os.close(send)
    with os.fdopen(receive, "rb") as pipe:
        report = pipe.read().decode(errors="replace")
    well = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    shutil.rmtree(base, ignore_errors=True)
    return well, report


def main() -> None:
    """Repeat rounds, and say how they went."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("seeds", type=int, nargs="*")
    parser.add_argument("--from", dest="first", type=int, default=0)
    parser.add_argument("--to", dest="last", type=int, default=-1)
    given = parser.parse_args()
    failed = []
    start = time.monotonic()
    seeds = [*given.seeds, *range(given.first, given.last + 1)]
    for seed in seeds:
        well, report = play(seed)
        print(f"{seed} {'ok' if well else 'FAILED'} {report}", flush=True)
        if not well:
            failed.append(seed)
    print(f"{len(seeds)} rounds, {len(failed)} failed {failed}, {time.monotonic() - start:.0f} s")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
