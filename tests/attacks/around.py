"""What attacks on the surroundings of a run have in common: how one is entered, run and judged."""

from __future__ import annotations

import os
import resource
import shlex
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

from tests.attacks.program import COMMAND, Ended, end, environment, leftovers, lies, rsgen, start, write_case

Attack = Callable[[Path], str]
"""Runs a command in an empty folder with a warm cache; gives what is wrong, "" where nothing is."""

ATTACKS: list[Attack] = []
MOUNTING: list[Attack] = []
"""Those that need a mount namespace."""

DONE, REFUSED = (0,), (2,)


def attack(function: Attack) -> Attack:
    """Enter an attack in the list."""
    ATTACKS.append(function)
    return function


def mounting(function: Attack) -> Attack:
    """Enter an attack that needs a mount namespace."""
    MOUNTING.append(function)
    return function


def judge(place: Path, ended: Ended, *codes: int, spoken: bool = True) -> str:
    """Say what is wrong with an end and with what it left; ``spoken``: somebody could read standard error."""
    fault = ended.fault(*codes)
    if not fault and ended.code == 2 and spoken and not ended.err.strip():
        fault = "code 2 without a word"
    if not fault and ended.err.count("\n") > 3:
        fault = f"more than a sentence: {ended.err[:400]}"
    halves = lies(place / "out") + leftovers(place / "out", place / "tmp")
    return fault or "; ".join(halves)


def run_small(place: Path, *, around: dict[str, str] | None = None, **options: object) -> Ended:
    words = ("run", write_case(place), "--out", place / "out", "--jobs", "1")
    return rsgen(*words, env=around or environment(place), **options)


def in_shell(place: Path, line: str, around: dict[str, str] | None = None) -> Ended:
    """Run a line of the shell in which ``rsgen`` is the command."""
    program = f'rsgen() {{ {shlex.join(COMMAND)} "$@"; }}\n'
    return end(start((), command=["bash", "-c", program + line], cwd=place, env=around or environment(place)))


def mounted(place: Path, mounts: str, line: str, around: dict[str, str] | None = None) -> Ended:
    """Run a line in a mount namespace of its own, after some mounts that nobody else sees."""
    program = f'rsgen() {{ {shlex.join(COMMAND)} "$@"; }}\n{mounts}\n{line}'
    command = [*namespace(), "bash", "-ec", program]
    return end(start((), command=command, cwd=place, env=around or environment(place)))


@cache
def namespace() -> tuple[str, ...]:
    """Give the words that make a mount namespace; () where the system does not allow one."""
    words = ("unshare", "--mount") if os.geteuid() == 0 else ("unshare", "--mount", "--map-root-user")
    try:
        tried = subprocess.run(
            [*words, "mount", "-t", "tmpfs", "none", "/mnt"], check=False, capture_output=True, timeout=10
        )
    except (OSError, subprocess.TimeoutExpired):
        return ()
    return words if tried.returncode == 0 else ()


def limited(kind: int, most: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(kind, (most, most))
