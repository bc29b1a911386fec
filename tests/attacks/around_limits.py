"""Limits of the system, and variables that name what is not there."""

from __future__ import annotations

import os
import resource
from pathlib import Path

from tests.attacks.around import DONE, REFUSED, attack, in_shell, judge, limited, run_small
from tests.attacks.program import environment, lies, rsgen, write_case

# ---------------------------------------------------------------- limits


def _descriptors(place: Path, most: int) -> str:
    write_case(place, "two")
    line = f"ulimit -n {most}; rsgen run small.toml two.toml --out out --jobs 2"
    write_case(place)
    return judge(place, in_shell(place, line), *DONE, *REFUSED)


@attack
def descriptors_32(place: Path) -> str:
    """``ulimit -n 32``."""
    return _descriptors(place, 32)


@attack
def descriptors_16(place: Path) -> str:
    """``ulimit -n 16``."""
    return _descriptors(place, 16)


@attack
def memory_700(place: Path) -> str:
    """700 MB of address space."""
    return judge(place, in_shell(place, _little_memory(place, 700)), *DONE, *REFUSED)


@attack
def memory_300(place: Path) -> str:
    """300 MB of address space."""
    return judge(place, in_shell(place, _little_memory(place, 300)), *DONE, *REFUSED)


@attack
def memory_700_pooled(place: Path) -> str:
    """700 MB of address space for each of two processes."""
    write_case(place, "two")
    line = (
        _little_memory(place, 700)
        .replace("--jobs 1", "--jobs 2")
        .replace("small.toml", "small.toml two.toml")
    )
    return judge(place, in_shell(place, line), *DONE, *REFUSED)


def _little_memory(place: Path, megabytes: int) -> str:
    write_case(place)
    return f"ulimit -v {1024 * megabytes}; rsgen run small.toml --out out --jobs 1"


@attack
def small_files(place: Path) -> str:
    """No file may be larger than 64 kB."""
    return judge(place, run_small(place, preexec_fn=limited(resource.RLIMIT_FSIZE, 64 * 1024)), *REFUSED)


@attack
def no_core_of_time(place: Path) -> str:
    """The system ends the process after 2 s of work; the next run clears up."""
    ended = run_small(place, preexec_fn=limited(resource.RLIMIT_CPU, 2))
    if ended.code not in (0, -9, -24) or "Traceback" in ended.err:
        return f"exit code {ended.code}: {ended.err[-300:]}"
    return judge(place, run_small(place), *DONE)


# ---------------------------------------------------------------- variables


def _with(place: Path, **changes: str | None) -> str:
    return judge(place, run_small(place, around=environment(place, **changes)), *DONE)


@attack
def temporary_folder_missing(place: Path) -> str:
    """TMPDIR names no folder."""
    return _with(place, TMPDIR=str(place / "absent"))


@attack
def temporary_folder_long(place: Path) -> str:
    """TMPDIR is longer than the name of a socket may be."""
    folder = place / ("t" * 180)
    folder.mkdir()
    write_case(place, "two")
    write_case(place)
    line = "rsgen run small.toml two.toml --out out --jobs 2"
    return judge(place, in_shell(place, line, environment(place, TMPDIR=str(folder))), *DONE)


@attack
def no_home(place: Path) -> str:
    """HOME is not set, nor is a folder for caches or settings."""
    return _with(place, HOME=None, RSGEN_CACHE=None, MPLCONFIGDIR=None, XDG_CACHE_HOME=str(place / "xdg"))


@attack
def home_missing(place: Path) -> str:
    """HOME names a folder that cannot be made."""
    absent = "/proc/nobody"
    return _with(place, HOME=absent, RSGEN_CACHE=None, MPLCONFIGDIR=None, XDG_CACHE_HOME=None)


def _named_with_umlauts(place: Path, **changes: str | None) -> str:
    case = write_case(place, title="Größe μ → Ω")
    case = case.rename(place / "Prüfung.toml")
    ended = rsgen("run", case, "--out", place / "Ergebnisse ä", env=environment(place, **changes))
    fault = ended.fault(*DONE) or "; ".join(lies(place / "Ergebnisse ä"))
    if fault:
        return fault
    ended = rsgen("check", place / "Prüfüng.toml", env=environment(place, **changes))
    return judge(place, ended, *REFUSED)


@attack
def plain_locale(place: Path) -> str:
    """LC_ALL=C with no UTF-8 mode; names and titles have other letters."""
    return _named_with_umlauts(place, LC_ALL="C", LANG=None, PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")


@attack
def ascii_output(place: Path) -> str:
    """PYTHONIOENCODING=ascii; names and titles have other letters."""
    return _named_with_umlauts(place, PYTHONIOENCODING="ascii")


@attack
def no_locale(place: Path) -> str:
    """A locale that is not there."""
    return _named_with_umlauts(place, LC_ALL="xx_XX.nonsense", LANG="xx")


@attack
def latin_names(place: Path) -> str:
    """A case file whose name is no UTF-8."""
    case = write_case(place).rename(place / os.fsdecode(b"Pr\xfcfung.toml"))
    words = ("run", case, "--out", place / "out")
    return judge(place, rsgen(*words, env=environment(place)), *DONE, *REFUSED)


@attack
def umask_of_one(place: Path) -> str:
    """``umask 077``: files are for the user alone."""
    write_case(place)
    fault = judge(place, in_shell(place, "umask 077; rsgen run small.toml --out out"), *DONE)
    return fault or ("files that others read" if (place / "out").stat().st_mode & 0o077 else "")


@attack
def umask_of_none(place: Path) -> str:
    """``umask 0777``: not even the user may use what the run makes."""
    write_case(place)
    ended = in_shell(place, "umask 0777; rsgen run small.toml --out out --jobs 1")
    return ended.fault(*DONE, *REFUSED)


@attack
def odd_time_zones(place: Path) -> str:
    """Time zones that do not exist, and the one that is farthest ahead."""
    for zone in ("Nowhere/Nothing", "", "UTC+99:99", "Pacific/Kiritimati", ":/etc/passwd", "\u00b5" * 300):
        fault = judge(place, rsgen("laws", env=environment(place, TZ=zone)), *DONE)
        if fault:
            return f"{zone}: {fault}"
    return _with(place, TZ="Nowhere/Nothing")


@attack
def library_folders(place: Path) -> str:
    """Variables of the libraries name what is no folder."""
    names = (
        "MPLCONFIGDIR",
        "NUMBA_CACHE_DIR",
        "IPYTHONDIR",
        "JUPYTER_CONFIG_DIR",
        "XDG_CACHE_HOME",
        "XDG_CONFIG_HOME",
    )
    return _with(place, **dict.fromkeys(names, "/dev/null/folder"))


@attack
def library_settings(place: Path) -> str:
    """Variables of the libraries hold nonsense."""
    return _with(
        place, MPLBACKEND="nonsense", NUMBA_OPT="nonsense", NUMBA_CPU_NAME="nonsense", COLUMNS="x", LINES="-1"
    )


@attack
def library_threads(place: Path) -> str:
    """Numbers of threads are none."""
    return _with(place, OMP_NUM_THREADS="many", NUMBA_NUM_THREADS="2", RSGEN_THREADS="many")


@attack
def cache_is_a_file(place: Path) -> str:
    """RSGEN_CACHE names a file."""
    (place / "taken").touch()
    return _with(place, RSGEN_CACHE=str(place / "taken"))


@attack
def strict_warnings(place: Path) -> str:
    """PYTHONWARNINGS=error."""
    return _with(place, PYTHONWARNINGS="error")
