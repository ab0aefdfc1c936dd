"""A process that tries inputs one after another and tells what came of each; it may die of any of them."""

import faulthandler
import gc
import os
import pickle
import re
import resource
import shutil
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from types import CodeType, FrameType
from typing import Any

from sdm_deflect.cases.errors import is_reported
from tests.fuzz.inputs import Input
from tests.fuzz.oracle import WrongError, is_single
from tests.fuzz.targets import Target

ROOT = Path(__file__).resolve().parents[2]
OURS = tuple(f"/{name}/" for name in ("deform", "geometry", "meshing", "cases"))
GUIDED = ("/meshing/", "/cases/", "/deform/surface/motions", "/deform/mesh")
MOST = 1 << 30
"""Bytes of memory that a process may take, `LOADED` of them for what is loaded; of addresses it may take twice more."""
LOADED = 1 << 28
LARGEST_FILE = 1 << 28
COLLECT = 100
WORD = re.compile(r"[A-Za-z]{3,}")
CURRENT, STACK = "current.pickle", "stack.txt"

Lines = set[tuple[str, int]]


@dataclass(frozen=True, slots=True)
class Result:
    """What came of an input.

    Attributes
    ----------
    number : of the input.
    kind : ``ok``, ``clean`` (an error that is reported), or what is wrong.
    where : the error's type and the innermost lines of ours, by which two results are the same.
    text : message and stack.
    """

    number: int
    kind: str
    where: str = ""
    text: str = field(default="", repr=False)
    seconds: float = 0.0
    peak: int = 0
    new_lines: tuple[tuple[str, int], ...] = ()
    kept: Input | None = None

    @property
    def good(self) -> bool:
        """Whether nothing is wrong."""
        return self.kind in ("ok", "clean")


class Guide:
    """Notes which lines of the readers have run; a line is looked at until it has run once."""

    def __init__(self, seen: Lines) -> None:
        self.seen, self.new = seen, set[tuple[str, int]]()
        self.left: dict[CodeType, set[int]] = {}

    def __call__(self, frame: FrameType, event: str, arg: Any) -> Any:
        """Trace the calls of code that has lines left."""
        code = frame.f_code
        left = self.left.get(code)
        if left is None:
            left = self.left[code] = self._lines(code)
        return self._line if left else None

    def _line(self, frame: FrameType, event: str, arg: Any) -> Any:
        left = self.left[frame.f_code]
        if event == "line" and frame.f_lineno in left:
            left.discard(frame.f_lineno)
            self.new.add((frame.f_code.co_filename, frame.f_lineno))
        return self._line if left else None

    def _lines(self, code: CodeType) -> set[int]:
        if not any(part in code.co_filename for part in GUIDED) or "/tests/" in code.co_filename:
            return set()
        lines = {line for _, _, line in code.co_lines() if line}
        return lines - {line for name, line in self.seen if name == code.co_filename}


def work(channel: Connection, target: Target, run: "Slice", folder: Path, known: Sequence[Input], seen: Lines) -> None:
    """Try the inputs of a slice and send a `Result` for each; be a process of its own.

    Parameters
    ----------
    channel : where to send results.
    run : which inputs.
    folder : an empty one, for files.
    known : sound inputs, and such as reached new lines.
    seen : lines that earlier inputs reached; None: no guidance.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with (folder / STACK).open("w") as stack:
        faulthandler.enable(stack)
        faulthandler.register(signal.SIGUSR1, stack, all_threads=False)
        _limit()
        with _caught_output(folder) as output:
            guide = Guide(seen) if run.guided else None
            try:
                for number in run.numbers:
                    if number % COLLECT == 0:
                        gc.collect()
                    channel.send(_tried(target, run.seed, number, folder, known, output, guide))
            except BaseException:
                stack.write(traceback.format_exc())  # a defect of the fuzzer
                raise


@dataclass(frozen=True, slots=True)
class Slice:
    """Which inputs of a target: their numbers, from `seed`; `guided` if known ones grow."""

    seed: int
    numbers: range
    guided: bool = False


def random_of(seed: int, target: Target, number: int) -> Random:
    """Return what decides an input."""
    return Random(f"{seed}/{target.name}/{number}")


def input_of(target: Target, seed: int, number: int, known: Sequence[Input]) -> Input:
    """Return an input: the sound ones as they are, then damaged ones."""
    return known[number] if number < len(known) else target.input(random_of(seed, target, number), known)


def _tried(
    target: Target, seed: int, number: int, folder: Path, known: Sequence[Input], output: Any, guide: Guide | None
) -> Result:
    given = input_of(target, seed, number, known)
    (folder / CURRENT).write_bytes(pickle.dumps(given))
    place = folder / "in"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    given.put(place)
    Path("/proc/self/clear_refs").write_text("5")  # the peak of memory is that of this input
    start, size = _seconds(), _resident()
    if guide:
        guide.new = set()
        sys.settrace(guide)
    try:
        kind, where, text = outcome(target, place, given, random_of(seed, target, -number))
    finally:
        sys.settrace(None)
    seconds, peak = _seconds() - start, _peak() - size + LOADED
    printed = output()
    if kind in ("ok", "clean"):
        if changed := [name for name, data in given.files.items() if _content(place / name) != data]:
            kind, where, text = "CHANGED", changed[0], f"the input {changed[0]} was changed"
        elif printed and not given.words:
            kind, where, text = "NOISE", " ".join(WORD.findall(printed)[:6]), printed[:2000]
        elif peak > MOST:
            kind, text = "MEMORY", f"{peak / 1e6:.0f} MB; {text}"
    new = tuple(sorted(guide.new)) if guide else ()
    return Result(number, kind, where, text, seconds, peak, new, given if new or kind not in ("ok", "clean") else None)


def outcome(target: Target, place: Path, given: Input, random: Random) -> tuple[str, str, str]:
    """Run a target on an input; return kind, place and text of what came of it."""
    told: list[tuple[str, str]] = []

    def note(message: Any, category: Any, filename: str, line: int, file: Any = None, text: Any = None) -> None:
        stack = traceback.extract_stack()
        told.append((f"{category.__name__} {_frames(stack)}", f"{message}\n{''.join(stack.format()[-8:])}"))

    here = Path.cwd()
    os.chdir(place)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        for unseen in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", unseen)  # as for users
        warnings.showwarning = note
        try:
            target.run(place, given, random)
            found = "ok", "", ""
        except WrongError as error:
            found = "WRONG", str(error)[:200], _stack(error)
        except KeyboardInterrupt as error:
            found = "INTERRUPTED", _place(error), _stack(error)
        except MemoryError as error:
            found = "MEMORY", _place(error), _stack(error)
        except Exception as error:  # whatever it is, it is the finding
            kind = ("clean" if is_single(str(error)) else "LINES") if is_reported(error) else "TRACEBACK"
            found = kind, _place(error), "" if kind == "clean" else _stack(error)
        finally:
            os.chdir(here)
    if told and found[0] in ("ok", "clean"):
        return "WARNING", *told[0]
    return found


def _stack(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))[-6000:]


def _place(error: BaseException) -> str:
    while error.__cause__:
        error = error.__cause__
    return f"{type(error).__name__} {_frames(traceback.extract_tb(error.__traceback__))}"


def _frames(stack: Sequence[traceback.FrameSummary]) -> str:
    own = [
        frame
        for frame in stack
        if any(part in frame.filename for part in OURS) and "site-packages" not in frame.filename
    ]
    last = [f"{Path(frame.filename).stem}.{frame.name}:{frame.lineno}" for frame in own[-2:]]
    return " > ".join(last)


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _limit() -> None:
    """Bound addresses, files and dumps of this process and its children."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + 2 * MOST,) * 2)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _seconds() -> float:
    """Seconds of processor time of this process and its children."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _resident(what: str = "VmRSS:") -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith(what)))


def _peak() -> int:
    return max(_resident("VmHWM:"), 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


@contextmanager
def _caught_output(folder: Path) -> Iterator[Any]:
    """Send what this process and libraries print to a file; yield what returns it and empties the file."""
    handle = os.open(folder / "printed.txt", os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    for number in (1, 2):
        os.dup2(handle, number)

    def printed() -> str:
        sys.stdout.flush()
        sys.stderr.flush()
        size = os.fstat(handle).st_size
        text = os.pread(handle, min(size, 1 << 16), 0).decode("utf-8", "replace") if size else ""
        os.ftruncate(handle, 0)
        return text

    yield printed
