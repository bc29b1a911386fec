"""The program: its commands, and the frame of each: interrupts, streams, limits, a sentence for each fault.

Of the commands only the one that is run is imported.
"""

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
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

import rsgen
from rsgen.app.cli.terminal import FAULTY, INTERRUPTED, open_streams, output_fault, print_faults, print_line
from rsgen.common.errors import RsgenError, faults_of, keep_from_terminal, one_line, program_fault
from rsgen.common.process import collect_seldom, leave_at_once, single_thread

COMMANDS = {
    "run": "From case files to reports.",
    "check": "Find every fault in case files.",
    "derive": "Describing functions of a force law.",
    "identify": "From a case to its parameters.",
    "profile": "The interval of one parameter by its likelihood.",
    "rank": "Which law? The library ranked on a test.",
    "diff": "What changed between two results.",
    "inspect": "What is in a data file.",
    "init": "Begin a case file.",
    "laws": "The library of force laws.",
    "examples": "Cases and data of the documentation.",
    "modal": "Frequency and damping over amplitude, without a law.",
}
"""Each command with its line in the help; it stands in the file and the function that bear its name."""


class _Commands(TyperGroup):
    """The commands of the table; one of them is imported when it is run, or asked for its help."""

    def __init__(self, **options: Any) -> None:
        lines = {name: TyperCommand(name, short_help=line) for name, line in COMMANDS.items()}
        super().__init__(**options | {"commands": lines})

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the first word names, and the words behind it."""
        name, known, words = super().resolve_command(ctx, args)
        if known is None:
            return name, known, words
        single = typer.Typer(add_completion=False, rich_markup_mode=None)
        single.command(name)(getattr(import_module(f"rsgen.app.cli.{name}_command"), f"{name}_command"))
        return name, get_command(single), words


application = typer.Typer(
    name="rsgen",
    cls=_Commands,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="""Identify nonlinear springs and dampers from the response surface of a vibration test.

    A case file says what vibrates (laws of springs and dampers), how it is tested (simulated or measured)
    and what must come out. rsgen reads or simulates the response surface, identifies every parameter, and
    writes a report that is one HTML file.

    \b
    First steps:
      rsgen init gearbox                         write a commented case file
      rsgen check gearbox.toml                   find every fault in it, say what a run will do
      rsgen run gearbox.toml                     simulate, identify, compare, report
      rsgen examples .                           the cases and data of the documentation, in cases/
      rsgen run cases --out reports              the same for a folder of cases
      rsgen inspect sweep.mat                    what is in a measured file
      rsgen derive "k1*x + kn1*x**3 + c1*v"      equivalent stiffness and damping of any law
      rsgen rank cases/cubic.toml                find the law behind a test
      rsgen diff reports/before reports/after    what changed between two results

    \b
    Exit codes:
      0    every result is accepted or identified: a script may go on
      1    a result is missed (outside [accept]), doubtful or rejected: look at it first
      2    faulty input
      130  interrupted
    """,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        print_line(f"rsgen {rsgen.__version__}")
        raise typer.Exit


@application.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


# ----------------------------------------------------------------------------
# The frame of every command.

CLEARING_SECONDS = 2.0
"""A second interrupt within this time is ignored, so that clean-up can finish."""

_SOON = 0.05
"""Seconds after which an interrupt that Python threw away is repeated."""

_last = -CLEARING_SECONDS


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _last
    now = time.monotonic()
    if now - _last < CLEARING_SECONDS:
        return
    if _imports(frame):
        threading.Timer(_SOON, interrupt_main).start()
        return
    _last = now
    raise KeyboardInterrupt


def _imports(frame: FrameType | None) -> bool:
    """Return True within an import: compiled modules make an ImportError of an interrupt."""
    while frame is not None and frame.f_code.co_filename != "<frozen importlib._bootstrap>":
        frame = frame.f_back
    return frame is not None


def _repeat(lost: sys.UnraisableHookArgs) -> None:
    """Interrupt again where Python threw the interrupt away, in a finalizer."""
    global _last
    if isinstance(lost.exc_value, KeyboardInterrupt):
        _last = -CLEARING_SECONDS
        threading.Timer(_SOON, interrupt_main).start()
    else:
        sys.__unraisablehook__(lost)


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
        # figures go to files alone, and the user's choice of windows need not be there
        os.environ["MPLBACKEND"] = "agg"
        # they would be looked for among all packages installed, and add nothing to case files
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        words = list(sys.argv[1:] if arguments is None else arguments)
        code = application(args=words or ["--help"], prog_name="rsgen", standalone_mode=False)
        incomplete = output_fault()
        if incomplete is not None:
            raise RsgenError(incomplete)
        if code == INTERRUPTED:
            # the command line library has turned Ctrl-C into this code without a word
            raise KeyboardInterrupt
    except RsgenError as fault:
        print_faults(faults_of(fault, ""))
        code = FAULTY
    except KeyboardInterrupt:
        # a second Ctrl-C must not interrupt the clean-up; as it ends Python resets signals that have a
        # handler, but not those that are ignored
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
            where = getattr(getattr(fault, "ctx", None), "command_path", "rsgen")
            print_faults([f"{where}: {one_line(message())} See: {where} --help"])
        code = FAULTY
    # what a fault left unwritten would end in a complaint of Python's
    output_fault()
    sys.exit(code if isinstance(code, int) else 0)
