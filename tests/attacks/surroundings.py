"""A run where something around it is missing, full, closed, too long or forbidden.

``python -m tests.attacks surroundings``. Each attack runs one command and must end with a result that
verifies, or with code 2 and a sentence a fault; never with a traceback, a hang or half a result. What needs
a file system of its own is tried in a mount namespace, where the system allows one.
"""

from __future__ import annotations

import shutil
from pathlib import Path

# both enter their attacks in the list
from tests.attacks import around_files, around_limits
from tests.attacks.around import ATTACKS, MOUNTING, Attack, namespace, run_small
from tests.attacks.program import Row, row, temporary

__all__ = ["around_files", "around_limits", "run", "tried_here", "try_once"]


def tried_here() -> list[Attack]:
    """List the attacks that this system allows."""
    return [*ATTACKS, *(MOUNTING if namespace() else ())]


def run(count: int, seed: int) -> list[Row]:
    """Try ``count`` attacks, spread over all kinds; nothing here is left to chance."""
    attacks = tried_here()
    attacks = attacks[:: max(1, len(attacks) // count)][:count]
    wrong = []
    with temporary() as warm:
        ended = run_small(warm)
        if ended.fault(0):
            raise RuntimeError(f"an undisturbed run failed: {ended.fault(0)}")
        for chosen in attacks:
            fault = try_once(chosen, warm / "cache")
            wrong += [f"{chosen.__name__}: {fault}"] * bool(fault)
    shown = f" ({'; '.join(wrong[:20])})" if wrong else ""
    left = "" if namespace() else f"; {len(MOUNTING)} that need a mount namespace not tried"
    return [
        row(
            f"surroundings, {len(attacks)} kinds: tracebacks, hangs, half results, wrong exit codes",
            "0",
            f"{len(wrong)} of {len(attacks)}{left}{shown}",
        )
    ]


def try_once(chosen: Attack, warm: Path) -> str:
    """Try an attack in a folder of its own with a copy of a warm cache."""
    with temporary() as place:
        if warm.is_dir():
            shutil.copytree(warm, place / "cache")
        return chosen(place)
