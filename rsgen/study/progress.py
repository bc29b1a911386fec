"""How far a case has come: small messages from wherever it runs, also from another process."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Step", "Tell", "tell_seldom"]

_SECONDS = 0.2
"""Between two messages of one stage: no eye follows more, and a pipe takes only so many."""


@dataclass(frozen=True, slots=True)
class Step:
    """A case has come to a stage, or to a share of it.

    Parameters
    ----------
    path
        The case file.
    stage
        One of ``STAGES``.
    share
        From 0 to 1; 0 where the stage has begun and does not tell more.
    expected
        Seconds of each stage, as expected before the run.
    """

    path: Path
    stage: str
    share: float
    expected: dict[str, float]


Tell = Callable[[Step], None]


def tell_seldom(tell: Tell, path: Path, expected: dict[str, float]) -> Callable[[str, float], None]:
    """Give a function of stage and share that passes on every new stage, and shares now and then."""
    last: list[tuple[str, float]] = []

    def note(stage: str, share: float) -> None:
        now = time.monotonic()
        if not last or last[0][0] != stage or now - last[0][1] > _SECONDS:
            last[:] = [(stage, now)]
            tell(Step(path, stage, share, expected))

    return note
