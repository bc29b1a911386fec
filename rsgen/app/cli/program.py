"""The frame of every command: interrupts, streams, limits, and a sentence and an exit code for each fault."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from _thread import interrupt_main
from collections.abc import Sequence
from importlib import import_module
from types import FrameType
from typing import Any

from rsgen.app.cli.terminal import FAULTY, INTERRUPTED, open_streams, output_fault, print_faults
from rsgen.common.errors import CaseError, RsgenError, keep_from_terminal, program_fault
from rsgen.common.process import collect_seldom, leave_at_once, single_thread

__all__ = ["run_program"]

CLEARING_SECONDS = 2.0
"""For so long after an interrupt another one is the same one: clearing up must not be torn apart."""

LEAST_MEGABYTES = 400
"""Of address space. With 300 the library of linear algebra ends the process as it is loaded, with a code and
words of its own; from 350 on what is missing becomes an error of Python."""

_SOON = 0.05
"""Seconds after which an interrupt that Python threw away is repeated."""

_last = -CLEARING_SECONDS


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _last
    now = time.monotonic()
    if now - _last >= CLEARING_SECONDS:
        _last = now
        raise KeyboardInterrupt


def _repeat(lost: sys.UnraisableHookArgs) -> None:
    """Interrupt again where Python threw the interrupt away, in a finalizer or an import."""
    global _last
    if isinstance(lost.exc_value, KeyboardInterrupt):
        _last = -CLEARING_SECONDS
        threading.Timer(_SOON, interrupt_main).start()
    else:
        sys.__unraisablehook__(lost)


def _check_memory() -> None:
    """Refuse a limit under which a library would end the process itself.

    Raises
    ------
    RsgenError
        The address space is limited to less than ``LEAST_MEGABYTES``.
    """
    if os.name != "posix":
        return
    resource: Any = import_module("resource")
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most != resource.RLIM_INFINITY and most < LEAST_MEGABYTES * 2**20:
        raise RsgenError(
            f"ulimit -v: memory is limited to {most // 2**20} MB; at least {LEAST_MEGABYTES} MB are needed, "
            "a run takes two to three times as much"
        )


def run_program(arguments: Sequence[str] | None) -> None:
    """Run a command and exit with its code; ``arguments`` as in ``rsgen.app.cli.main``."""
    code: object = FAULTY
    try:
        # a polite end from outside clears up as Ctrl-C does
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _interrupt)
        sys.unraisablehook = _repeat
        open_streams()
        keep_from_terminal()
        single_thread()
        collect_seldom()
        leave_at_once()
        _check_memory()
        # figures go to files alone, and the user's choice of windows need not be there
        os.environ["MPLBACKEND"] = "agg"
        # they would be looked for among all packages installed, and add nothing to case files
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        from rsgen.app.cli.application import application

        words = list(sys.argv[1:] if arguments is None else arguments)
        code = application(args=words or ["--help"], prog_name="rsgen", standalone_mode=False)
        incomplete = output_fault()
        if incomplete is not None:
            raise RsgenError(incomplete)
        if code == INTERRUPTED:
            # the command line library has turned Ctrl-C into this code without a word
            raise KeyboardInterrupt
    except CaseError as fault:
        print_faults(fault.faults)
        code = FAULTY
    except RsgenError as fault:
        print_faults([" ".join(str(fault).split())])
        code = FAULTY
    except KeyboardInterrupt:
        # what is left to clear up at the exit must not be torn apart by an impatient second one; at its end
        # Python gives signals with a handler back to the system, and those that are ignored stay so
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        print_faults(["rsgen: interrupted; nothing half-written was left"])
        code = INTERRUPTED
    except Exception as fault:
        # faults of usage come from the command line library and know how to say themselves
        message = getattr(fault, "format_message", None)
        if message is None:
            print_faults([program_fault(fault, "rsgen")])
        else:
            print_faults([f"rsgen: {' '.join(str(message()).split())} See: rsgen --help"])
        code = FAULTY
    # what a fault left unwritten would end in a complaint of Python's
    output_fault()
    sys.exit(code if isinstance(code, int) else 0)
