"""What a user sees only on request: warnings of libraries, and where a fault of the program came from."""

from __future__ import annotations

import logging
import os

__all__ = ["DEBUG_VARIABLE", "keep_from_terminal", "program_fault"]

DEBUG_VARIABLE = "RSGEN_DEBUG"
"""Environment variable: set to anything, it shows warnings of libraries and tracebacks on standard error."""


def keep_from_terminal() -> None:
    """Send warnings and messages of libraries to the log, for this process.

    What matters to a reader of a result is a finding; the text of a library names neither case nor remedy.
    """
    logging.captureWarnings(True)
    root = logging.getLogger()
    if not root.handlers:
        # without any handler, Python prints messages of libraries itself
        root.addHandler(logging.NullHandler())
    if os.environ.get(DEBUG_VARIABLE):
        shown = logging.StreamHandler()
        for name in ("rsgen", "py.warnings"):
            logger = logging.getLogger(name)
            logger.handlers = [shown]
            logger.setLevel(logging.DEBUG)


def program_fault(fault: BaseException, about: str) -> str:
    """Say an error that nobody foresaw in a sentence, and write its traceback to the log.

    What the system refused, a file or memory, is no fault of the program.

    Parameters
    ----------
    fault
        While it is handled.
    about
        The case, or the program: what the sentence begins with.
    """
    logging.getLogger("rsgen").debug("%s failed", about, exc_info=True)
    if isinstance(fault, MemoryError):
        return f"{about}: there is too little memory for it; give the program more, or ask for fewer points"
    if isinstance(fault, OSError):
        what = " ".join(f"{fault.strerror or fault}{f': {name}' if (name := fault.filename) else ''}".split())
        return f"{about}: the system refuses what this needs: {what[:300]}"
    text = " ".join(f"{type(fault).__name__}: {fault}".split())
    if isinstance(fault, ImportError) and not isinstance(fault, ModuleNotFoundError):
        return f"{about}: a library cannot be loaded, perhaps for want of memory or open files: {text[:300]}"
    return (
        f"{about}: {text[:300]}; this is a fault of rsgen, please report it with the files "
        f"({DEBUG_VARIABLE}=1 shows where it came from)"
    )
