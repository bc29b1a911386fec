"""A run where something around it is missing, full, closed, too long or forbidden.

Each attack is a line of the shell, in a folder with three cases. It
must end with a result that verifies, or with code 2 and a sentence a fault; never with a traceback, a hang or
half a result. What needs a file system of its own is tried in a mount namespace, where the system allows one.
"""

import shlex
import shutil
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from os import geteuid
from pathlib import Path

from tests.attacks import program
from tests.attacks.program import Ended, Row, end, environment, start, temporary, write_case
from tests.programs import RSGEN

DONE, REFUSED = (0,), (2,)
EITHER = DONE + REFUSED
ONE = "rsgen run small.toml --out out --jobs 1"
POOL = "rsgen run small.toml two.toml --out out --jobs 2"


@dataclass(frozen=True)
class Line:
    """A line of the shell, and how it may end."""

    text: str  # ``{place}`` is the folder in which it runs
    codes: tuple[int, ...] = DONE  # exit codes that are right
    changes: Mapping[str, str | None] = field(default_factory=dict)  # variables; None: not set
    mounts: str = ""  # what is mounted before, for this line alone


def _with(text: str = ONE, codes: tuple[int, ...] = DONE, **changes: str | None) -> Line:
    return Line(text, codes, changes=changes)


N = "n" * 300
GONE, LATIN = "mkdir gone; cd gone;", r"$'Pr\xfcfung.toml'"
FULL_PATHS = "rsgen run {place}/small.toml --out {place}/out --jobs 2"
STREAMS = {
    "reader that leaves": Line("set -o pipefail; rsgen laws | head -1"),
    "reader that leaves a run": Line(f"set -o pipefail; {ONE} | true && test -d out/small"),
    "full output": Line(f"{ONE} > /dev/full", REFUSED),
    # the next file that is opened would take its number
    "closed output": Line(f"{POOL} >&-"),
    "closed errors": Line(f"{ONE} 2>&-"),
    "closed streams": Line("rsgen run *.toml --out out --jobs 2 <&- >&- 2>&-"),
}
NAMES = {
    "long name of a file": Line(f"mv small.toml {N[:250]}.toml; rsgen run {N[:250]}.toml --out out"),
    "name too long": Line(f"rsgen run {'n' * 5000}.toml", REFUSED),
    "output too long": Line(f"rsgen run small.toml --out {N}", REFUSED),
    # the folder can be made, and no file in it
    "output too deep": Line(
        f"deep={{place}}/{'/'.join(['d' * 200] * 19)}; rest=$((4089 - ${{#deep}}));"
        " rsgen run small.toml --out $deep/$(printf 'e%.0s' $(seq $rest))",
        REFUSED,
    ),
    **{f"name too long: {words.split()[0]}": Line(f"rsgen {words}", REFUSED) for words in (
        f"check {N}.toml", f"run small.toml --out {N}", f"inspect {N}.mat", f"init {N}.toml",
        f"diff {N} {N}", f"report --out {N}", f"identify {N}.toml", f"rank {N}.toml",
    )},
    "deleted folder": Line(f"{GONE} rmdir ../gone; {FULL_PATHS}", EITHER),
    "deleted folder, relative": Line(f"{GONE} cp ../*.toml .; rm -r ../gone; rsgen run small.toml", REFUSED),
    "read-only output": Line("rsgen run small.toml --out /proc/results", REFUSED),
    "name of a file that is no UTF-8": Line(f"mv small.toml {LATIN}; rsgen run {LATIN} --out out", EITHER),
}  # fmt: skip
UMLAUTS = (
    "sed -i 's/A small case/Größe μ → Ω/' small.toml; mv small.toml Prüfung.toml; "
    "rsgen run Prüfung.toml --out 'Ergebnisse ä' && mv 'Ergebnisse ä' out"
)
LOCALES: dict[str, dict[str, str | None]] = {
    "plain locale": {"LC_ALL": "C", "LANG": None, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "ASCII output": {"PYTHONIOENCODING": "ascii"},
    "locale that is not there": {"LC_ALL": "xx_XX.nonsense", "LANG": "xx"},
}
UNDO = "chmod -R 700 out tmp; rm -rf out tmp"
LIMITS = {
    **{f"{most} open files": Line(f"ulimit -n {most}; {POOL}", EITHER) for most in (32, 16)},
    "700 MB of memory": Line(f"ulimit -v {1024 * 700}; {ONE}", EITHER),
    "700 MB of memory, two processes": Line(f"ulimit -v {1024 * 700}; {POOL}", EITHER),
    "files of 64 kB": Line(f"ulimit -f 64; {ONE}", REFUSED),
    # the system ends the process; the next run clears up
    "2 s of work": Line(f"(ulimit -t 2; {ONE}); case $? in 0|137|152) {ONE};; *) exit 1;; esac"),
    "files for the user alone": Line(f"umask 077; {ONE}; test -z $(find out -maxdepth 0 -perm /077)"),
    "files for nobody": Line(f"umask 0777; {ONE}; code=$?; {UNDO}; exit $code", EITHER),
}  # fmt: skip
UNSET: dict[str, None] = dict.fromkeys(("RSGEN_CACHE", "MPLCONFIGDIR"))
FOLDERS = ("MPLCONFIGDIR", "NUMBA_CACHE_DIR", "IPYTHONDIR", "JUPYTER_CONFIG_DIR", "XDG_CACHE_HOME",
           "XDG_CONFIG_HOME")  # fmt: skip
VARIABLES = {
    "temporary folder that is missing": _with(TMPDIR="{place}/absent"),
    # longer than the name of a socket may be
    "temporary folder with a long name": _with(f"mkdir {N[:180]}; {POOL}", TMPDIR=f"{{place}}/{N[:180]}"),
    "no HOME": _with(HOME=None, **UNSET, XDG_CACHE_HOME="{place}/xdg"),
    "HOME that cannot be made": _with(HOME="/proc/nobody", **UNSET, XDG_CACHE_HOME=None),
    **{f"{name}: run": _with(UMLAUTS, **changes) for name, changes in LOCALES.items()},
    **{f"{name}: check": _with("rsgen check Prüfüng.toml", REFUSED, **v) for name, v in LOCALES.items()},
    "time zone that is none, a run": _with(TZ="Nowhere/Nothing"),
    **{f"time zone {zone[:30]!r}": _with("rsgen laws", TZ=zone) for zone in (
        "Nowhere/Nothing", "", "UTC+99:99", "Pacific/Kiritimati", ":/etc/passwd", "\u00b5" * 300
    )},
    "folders of libraries that are none": _with(**dict.fromkeys(FOLDERS, "/dev/null/folder")),
    "settings of libraries that are none": _with(
        MPLBACKEND="nonsense", NUMBA_OPT="nonsense", NUMBA_CPU_NAME="nonsense", COLUMNS="x", LINES="-1"
    ),
    "threads that are no number": _with(OMP_NUM_THREADS="many", NUMBA_NUM_THREADS="2", RSGEN_THREADS="many"),
    "cache that is a file": _with(f"touch taken; {ONE}", RSGEN_CACHE="{place}/taken"),
    "warnings as errors": _with(PYTHONWARNINGS="error"),
}  # fmt: skip

BOTH = "rsgen run small.toml two.toml --out out --jobs 1"
TMPFS = "mkdir -p out; mount -t tmpfs -o"
MOUNTED = {
    # less than one result takes; one result and not the second; space, and five more files
    "disk that is full": Line(BOTH, REFUSED, mounts=f"{TMPFS} size=300k none out"),
    "disk that fills": Line(BOTH, EITHER, mounts=f"{TMPFS} size=1600k none out"),
    "disk without names": Line(BOTH, REFUSED, mounts=f"{TMPFS} nr_inodes=6 none out"),
    "disk that is read-only": Line(POOL, REFUSED, mounts=f"{TMPFS} ro none out"),
    "temporary folder, home and cache that are full": Line(
        BOTH, changes={"TMPDIR": "{place}/f", "HOME": "{place}/f", "RSGEN_CACHE": "{place}/f/c"},
        mounts="(mkdir -p f; mount -t tmpfs -o size=4k none f; echo full > f/file;"
        " cat /dev/zero > f/more || true) 2> /dev/null",
    ),
    "only the results can be written": Line(
        POOL, EITHER, changes={"TMPDIR": "{place}/ro", "RSGEN_CACHE": "/mnt/cache"},
        mounts="mkdir -p out ro; mount -t tmpfs none out; mount -t tmpfs -o ro none ro;"
        " mount -o bind,ro /var/tmp /var/tmp; mount --bind . /mnt; mount --bind out /mnt/out;"
        " mount -t tmpfs -o ro none /tmp 2> /dev/null; cd /mnt; mount -o remount,bind,ro /mnt",
    ),
    "no semaphores": Line(POOL, EITHER, mounts="mount -t tmpfs -o ro none /dev/shm"),
    "empty /proc": Line(POOL, EITHER, mounts="mount -t tmpfs none /proc"),
}  # fmt: skip


def judge(place: Path, ended: Ended, *codes: int) -> str:
    """Say what is wrong with an end and with what it left."""
    fault = ended.fault(*codes)
    if not fault and ended.code == 2 and not ended.err.strip():
        fault = "code 2 without a word"
    if not fault and ended.err.count("\n") > 3:
        fault = f"more than a sentence: {ended.err[:400]}"
    out = place / "out"
    return fault or "; ".join(program.lies(out) + program.leftovers(out, place / "tmp"))


def attack(place: Path, line: Line) -> str:
    """Run a line in a folder with three cases; say what is wrong, "" where nothing is."""
    for name in ("small", "two", "three"):
        write_case(place, name)
    changes = {key: value and value.format(place=place) for key, value in line.changes.items()}
    begin = f'rsgen() {{ {shlex.join(RSGEN)} "$@"; }}\n'
    text = line.text.replace("{place}", str(place))
    command = ["bash", "-c", begin + text]
    if line.mounts:
        # what is mounted is gone with the namespace, so that it is looked at inside
        seen = "ls -A out 2> /dev/null | grep '^[.]' && echo Traceback: hidden files are left"
        text = f"{line.mounts}\nset +e; {text}; code=$?; {seen}; exit $code"
        command = [*namespace(), "bash", "-ec", begin + text]
    ended = end(start((), command=command, cwd=place, env=environment(place, **changes)))
    return judge(place, ended, *line.codes)


def _begun(place: Path, jobs: str) -> object:
    words = ("run", write_case(place), "--out", place / "out", "--jobs", jobs)
    process = start(words, env=environment(place))
    while not list((place / "out").glob(".small.*.part")) and process.poll() is None:
        pass
    return process


def changing_case(place: Path) -> str:
    """The case file changes while it runs: the result is that of the case as it was read."""
    process = _begun(place, "1")
    case = write_case(place, k=7000.0)
    if fault := judge(place, end(process), *DONE):
        return fault
    notebook = (place / "out" / "small" / "notebook.ipynb").read_text()
    if "k = 7000.0" in notebook or "k = 5920.0" not in notebook:
        return "the notebook holds another case than the result"
    again = program.rsgen("run", case, "--out", place / "out", env=environment(place))
    if "unchanged" in again.out:
        return "the changed case is taken for the one that ran"
    return judge(place, again, *DONE)


def vanishing_case(place: Path) -> str:
    process = _begun(place, "2")
    (place / "small.toml").unlink()
    return judge(place, end(process), *EITHER)


def two_runs_at_once(place: Path) -> str:
    words = ("run", write_case(place), write_case(place, "two"), "--out", place / "out", "--jobs", "1")
    both = [start(words, env=environment(place)) for _ in range(2)]
    # what the slower one still fills is no half result
    ended = [end(process) for process in both]
    return next(filter(None, [judge(place, one, *EITHER) for one in ended]), "")


ATTACKS: dict[str, Line | Callable[[Path], str]] = {
    **STREAMS, **NAMES, "case that changes": changing_case, "case that vanishes": vanishing_case,
    "two runs at once": two_runs_at_once, **LIMITS, **VARIABLES,
}  # fmt: skip


@cache
def namespace() -> tuple[str, ...]:
    """Return the words that make a mount namespace; () where the system does not allow one."""
    words = ("unshare", "--mount") if geteuid() == 0 else ("unshare", "--mount", "--map-root-user")
    mount = [*words, "mount", "-t", "tmpfs", "none", "/mnt"]
    try:
        subprocess.run(mount, check=True, capture_output=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return ()
    return words


def run(count: int, seed: int) -> list[Row]:
    """Try ``count`` attacks, spread over all kinds; nothing here is left to chance."""
    names = [*ATTACKS, *(MOUNTED if namespace() else ())]
    names = names[:: max(1, len(names) // count)][:count]
    wrong = []
    with temporary() as warm:
        if fault := attack(warm, Line(ONE)):
            raise RuntimeError(f"an undisturbed run failed: {fault}")
        for name in names:
            # in a folder of its own, with compiled kernels
            with temporary() as place:
                shutil.copytree(warm / "cache", place / "cache")
                chosen = (ATTACKS | MOUNTED)[name]
                fault = attack(place, chosen) if isinstance(chosen, Line) else chosen(place)
                wrong += [f"{name}: {fault}"] * bool(fault)
    left = "" if namespace() else f"; {len(MOUNTED)} that need a mount namespace not tried"
    figure = f"surroundings, {len(names)} kinds: tracebacks, hangs, half results, wrong exit codes"
    return [program.failures(figure, wrong, f" of {len(names)}{left}")]
