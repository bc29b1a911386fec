"""rsgen as its user starts it: in a session of its own, in surroundings that an attack has changed."""

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from rsgen.app.study.folder import read_manifest
from tests.case_files import CUBIC, write_small
from tests.programs import RSGEN

HANG_SECONDS = 180.0  # after which a command of these cases hangs; on a quiet machine they take 4 s
ORPHAN_SECONDS = 3.0  # after which a process that a run left is an orphan; one that clears up has 1 s

Row = tuple[str, list[int], str]  # of the table: a figure, counts that are to be 0, and more about them


def failures(figure: str, which: Sequence[str], more: str = "") -> Row:
    """Make a row of what none is asked for, with the first of those that there were."""
    shown = f" ({'; '.join(which[:5])})" if which else ""
    return figure, [len(which)], f"{more}{shown}"


def write_case(folder: Path, name: str = "small", *, k: float = 5920.0) -> Path:
    return write_small(folder, name, CUBIC | {"title": "A small case", "truth.k": k})


@dataclass(frozen=True)
class Ended:
    """What a command left: code (None: it had to be ended), both outputs, seconds, largest memory."""

    code: int | None
    out: str
    err: str
    seconds: float
    orphans: int

    def fault(self, *codes: int) -> str:
        """Say what is wrong with an end, in words; "" where nothing is."""
        if self.code is None:
            return f"hung for {self.seconds:.0f} s"
        for words in ("Traceback", "this is a fault of rsgen", "Fatal Python error", "Exception ignored"):
            if words in self.err or words in self.out:
                return f"{words!r}: {self.err[-600:]}"
        if self.code not in codes:
            return f"exit code {self.code}: {self.err[-300:]}"
        return f"{self.orphans} processes left" if self.orphans else ""


def session(leader: int) -> list[int]:
    """List the living processes of a session, by what the system says of each."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            # after the name, which is in brackets: state, parent, group, session
            state, _, _, number = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(number) == leader and state != "Z":
                found.append(int(entry.name))
    return found


def start(words: Sequence[str | Path], **options: object) -> subprocess.Popen[str]:
    """Start a command of rsgen; it leads a session, by which its processes are found again."""
    settings: dict = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    # one begun by a script in the background is born deaf to interrupts
    settings["preexec_fn"] = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
    settings |= {"text": True, "errors": "replace", "start_new_session": True} | options
    return subprocess.Popen(settings.pop("command", None) or [*RSGEN, *map(str, words)], **settings)


def end(process: subprocess.Popen[str], seconds: float = HANG_SECONDS) -> Ended:
    """Wait for the end of a command, then for that of its processes; end those that stay."""
    started, code, out, err = time.monotonic(), None, "", ""
    try:
        out, err = process.communicate(timeout=seconds)
        code = process.returncode
    except subprocess.TimeoutExpired:
        pass
    taken = time.monotonic() - started
    while (left := session(process.pid)) and code is not None:
        if time.monotonic() - started - taken > ORPHAN_SECONDS:
            break
        time.sleep(0.02)
    for number in left:
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    if code is None:
        with suppress(subprocess.TimeoutExpired):
            out, err = process.communicate(timeout=10)
    return Ended(code, out or "", err or "", taken, len(left))


def rsgen(*words: str | Path, **options: object) -> Ended:
    return end(start(words, **options))


def environment(place: Path, **changes: str | None) -> dict[str, str]:
    """Give what a command finds around it: folders of its own below ``place``, one thread, and changes."""
    own = {"HOME": "home", "TMPDIR": "tmp", "RSGEN_CACHE": "cache", "MPLCONFIGDIR": "matplotlib"}
    for name in own.values():
        (place / name).mkdir(exist_ok=True, mode=0o700)
    found = {**os.environ, **{key: str(place / name) for key, name in own.items()}}
    found |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RSGEN_THREADS"), "1")
    found["PYTHONPATH"] = str(Path(__file__).parents[2])
    return {key: value for key, value in {**found, **changes}.items() if value is not None}


def lies(out: Path) -> list[str]:
    """List what looks like a result in a folder of results and does not verify."""
    folders = [path for path in sorted(out.glob("[!.]*")) if path.is_dir()]
    found = [path.name for path in folders if read_manifest(path) is None]
    index = out / "index.html"
    if index.exists() and not index.read_text(encoding="utf-8").endswith(("</html>", "</html>\n")):
        found.append(index.name)
    return found


def leftovers(*folders: Path) -> list[str]:
    """List what a run that is over has no use for: hidden entries, and whatever lies in temporary folders."""
    found = [path for folder in folders for path in sorted(folder.glob("*"))]
    kept = [path for path in found if path.name.startswith(".") or path.parent.name == "tmp"]
    return [f"{path.parent.name}/{path.name}" for path in kept]


def verified(out: Path) -> list[str]:
    return [path.name for path in out.glob("*") if path.is_dir() and read_manifest(path) is not None]


@contextmanager
def temporary() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="rsgen-") as folder:
        yield Path(folder)
