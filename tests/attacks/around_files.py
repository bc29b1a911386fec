"""Streams closed or full, names too long, folders that go or cannot be written, files that change."""

from __future__ import annotations

import shlex
from pathlib import Path

from tests.attacks.around import DONE, REFUSED, attack, in_shell, judge, mounted, mounting
from tests.attacks.program import end, environment, rsgen, start, write_case

# ---------------------------------------------------------------- the three streams


@attack
def reader_that_leaves(place: Path) -> str:
    """``rsgen laws | head -1``."""
    ended = in_shell(place, "set -o pipefail; rsgen laws | head -1")
    return judge(place, ended, *DONE)


@attack
def reader_that_leaves_a_run(place: Path) -> str:
    """``rsgen run | true``: nobody reads what becomes of the cases."""
    write_case(place)
    ended = in_shell(place, "set -o pipefail; rsgen run small.toml --out out --jobs 1 | true")
    fault = judge(place, ended, *DONE)
    return fault or ("" if (place / "out" / "small").is_dir() else "no result")


@attack
def full_output(place: Path) -> str:
    """Standard output is a full device."""
    write_case(place)
    return judge(place, in_shell(place, "rsgen run small.toml --out out --jobs 1 > /dev/full"), *REFUSED)


@attack
def full_errors(place: Path) -> str:
    """Standard error is a full device, and there is a fault to say."""
    return judge(place, in_shell(place, "rsgen run absent.toml 2> /dev/full"), *REFUSED, spoken=False)


@attack
def full_outputs(place: Path) -> str:
    """Both are full."""
    ended = in_shell(place, "rsgen laws > /dev/full 2> /dev/full")
    return judge(place, ended, *REFUSED, spoken=False)


@attack
def closed_output(place: Path) -> str:
    """Standard output is closed, so that the next file opened would take its number."""
    write_case(place)
    return judge(place, in_shell(place, "rsgen run small.toml --out out --jobs 2 >&-"), *DONE)


@attack
def closed_errors(place: Path) -> str:
    """Standard error is closed."""
    write_case(place)
    return judge(place, in_shell(place, "rsgen run small.toml --out out --jobs 1 2>&-"), *DONE)


@attack
def closed_errors_with_a_fault(place: Path) -> str:
    """Standard error is closed, and there is a fault to say."""
    return judge(place, in_shell(place, "rsgen run absent.toml 2>&-"), *REFUSED, spoken=False)


@attack
def closed_streams(place: Path) -> str:
    """Input, output and errors are closed."""
    write_case(place)
    for name in ("two", "three"):
        write_case(place, name)
    line = "rsgen run small.toml two.toml three.toml --out out --jobs 2 <&- >&- 2>&-"
    return judge(place, in_shell(place, line), *DONE)


# ---------------------------------------------------------------- names and places


@attack
def long_name_of_a_file(place: Path) -> str:
    """A case file whose name has as many characters as a name may have."""
    path = place / f"{'n' * 250}.toml"
    write_case(place).rename(path)
    return judge(place, rsgen("run", path, "--out", place / "out", env=environment(place)), *DONE)


@attack
def name_too_long(place: Path) -> str:
    """A case that no system can have."""
    return judge(place, rsgen("run", f"{'n' * 5000}.toml", env=environment(place)), *REFUSED)


@attack
def output_too_long(place: Path) -> str:
    """A folder of results that no system can have."""
    ended = rsgen("run", write_case(place), "--out", place / ("o" * 300), env=environment(place))
    return judge(place, ended, *REFUSED)


@attack
def output_too_deep(place: Path) -> str:
    """A folder of results that can be made, and in which no file can be."""
    deep = place.joinpath(*["d" * 200] * 20)
    short = deep.parent / ("e" * (4090 - len(str(deep.parent)) - 1))
    ended = rsgen("run", write_case(place), "--out", short, env=environment(place))
    return judge(place, ended, *REFUSED)


@attack
def other_files_too_long(place: Path) -> str:
    """The files of the other commands have names too long."""
    case, name = write_case(place), "n" * 300
    commands = (
        *(("check", f"{name}.toml"), ("simulate", case, "--out", f"{name}.h5"), ("inspect", f"{name}.mat")),
        ("init", f"{name}.toml"),
        *(("diff", name, name), ("report", "--out", name)),
        *(("identify", case, "--surface", f"{name}.h5"), ("rank", f"{name}.h5")),
    )
    for words in commands:
        fault = judge(place, rsgen(*words, env=environment(place), cwd=place), *REFUSED)
        if fault:
            return f"{words[0]}: {fault}"
    return ""


@attack
def deleted_folder(place: Path) -> str:
    """The current folder is deleted; the case and the results are named from the root."""
    case = write_case(place)
    line = f"mkdir gone; cd gone; rmdir ../gone; rsgen run {case} --out {place / 'out'} --jobs 2"
    return judge(place, in_shell(place, line), *DONE, *REFUSED)


@attack
def deleted_folder_relative(place: Path) -> str:
    """The current folder is deleted, and everything is named from there."""
    line = "mkdir gone; cd gone; cp ../small.toml .; rm -r ../gone; rsgen run small.toml"
    write_case(place)
    return judge(place, in_shell(place, line), *REFUSED)


@attack
def read_only_output(place: Path) -> str:
    """The folder of results can be written by nobody."""
    ended = rsgen("run", write_case(place), "--out", "/proc/results", env=environment(place))
    return judge(place, ended, *REFUSED)


@attack
def changing_case(place: Path) -> str:
    """The case file changes while it runs: the result is that of the case as it was read."""
    case = write_case(place)
    before = case.read_text()
    process = start(("run", case, "--out", place / "out", "--jobs", "1"), env=environment(place))
    while not list((place / "out").glob(".small.*.part")) and process.poll() is None:
        pass
    write_case(place, k=7000.0)
    fault = judge(place, end(process), *DONE)
    notebook = (place / "out" / "small" / "notebook.ipynb").read_text() if not fault else ""
    if not fault and ("k = 7000.0" in notebook or "k = 5920.0" not in notebook):
        return "the notebook holds another case than the result"
    again = rsgen("run", case, "--out", place / "out", env=environment(place))
    if "unchanged" in again.out:
        return "the changed case is taken for the one that ran"
    case.write_text(before)
    return fault or judge(place, again, *DONE)


@attack
def vanishing_case(place: Path) -> str:
    """The case file is deleted while it runs."""
    case = write_case(place)
    process = start(("run", case, "--out", place / "out", "--jobs", "2"), env=environment(place))
    while not list((place / "out").glob(".small.*.part")) and process.poll() is None:
        pass
    case.unlink()
    return judge(place, end(process), *DONE, *REFUSED)


@attack
def two_runs_at_once(place: Path) -> str:
    """Two runs of the same cases in one folder."""
    words = ("run", write_case(place), write_case(place, "two"), "--out", place / "out", "--jobs", "1")
    both = [start(words, env=environment(place)) for _ in range(2)]
    faults = [judge(place, end(process), *DONE, *REFUSED) for process in both]
    return next(filter(None, faults), "")


# ---------------------------------------------------------------- file systems


def _run_mounted(place: Path, mounts: str, *codes: int, jobs: int = 1, **changes: str | None) -> str:
    write_case(place)
    write_case(place, "two")
    line = f"set +e; rsgen run small.toml two.toml --out out --jobs {jobs}; code=$?; {_SEEN}; exit $code"
    ended = mounted(place, mounts, line, environment(place, **changes))
    return judge(place, ended, *codes)


_SEEN = "ls -A out 2> /dev/null | grep '^[.]' && echo Traceback: hidden files are left"
"""What is mounted is gone with the namespace, so that it is looked at inside."""


@mounting
def full_disk(place: Path) -> str:
    """The disk of the results has 300 kB: less than one result takes."""
    return _run_mounted(place, "mkdir -p out; mount -t tmpfs -o size=300k none out", *REFUSED)


@mounting
def disk_that_fills(place: Path) -> str:
    """The disk of the results holds one result and not the second."""
    return _run_mounted(place, "mkdir -p out; mount -t tmpfs -o size=1600k none out", *DONE, *REFUSED)


@mounting
def disk_without_names(place: Path) -> str:
    """The disk of the results has space and takes five more files."""
    return _run_mounted(place, "mkdir -p out; mount -t tmpfs -o nr_inodes=6 none out", *REFUSED)


@mounting
def read_only_disk(place: Path) -> str:
    """The disk of the results is mounted read-only."""
    return _run_mounted(place, "mkdir -p out; mount -t tmpfs -o ro none out", *REFUSED, jobs=2)


@mounting
def temporary_folder_full(place: Path) -> str:
    """TMPDIR, HOME and the cache lie on a disk that is full."""
    mounts = (
        "mkdir -p f; mount -t tmpfs -o size=4k none f; echo full > f/file; cat /dev/zero > f/more || true"
    )
    full = str(place / "f")
    return _run_mounted(
        place, f"({mounts}) 2> /dev/null", *DONE, TMPDIR=full, HOME=full, RSGEN_CACHE=f"{full}/c"
    )


@mounting
def temporary_folder_read_only(place: Path) -> str:
    """TMPDIR, /tmp, /var/tmp and the current folder are read-only; only the results can be written."""
    mounts = (
        "mkdir -p out ro; mount -t tmpfs none out; mount -t tmpfs -o ro none ro; "
        f"mount -o bind,ro {shlex.quote(str(Path('/var/tmp')))} /var/tmp; "
        "mount --bind . /mnt; mount --bind out /mnt/out; "
        "mount -t tmpfs -o ro none /tmp 2> /dev/null; cd /mnt; mount -o remount,bind,ro /mnt"
    )
    return _run_mounted(
        place, mounts, *DONE, *REFUSED, jobs=2, TMPDIR=str(place / "ro"), RSGEN_CACHE="/mnt/cache"
    )


@mounting
def no_shared_memory(place: Path) -> str:
    """/dev/shm cannot be written, so that there are no semaphores."""
    return _run_mounted(place, "mount -t tmpfs -o ro none /dev/shm", *DONE, *REFUSED, jobs=2)


@mounting
def no_random_device(place: Path) -> str:
    """/proc is empty, as in some containers."""
    return _run_mounted(place, "mount -t tmpfs none /proc", *DONE, *REFUSED, jobs=2)
