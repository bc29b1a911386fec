"""The command line: the only place that prints or exits.

Exit codes: 0 every result is accepted or identified; 1 one is missed, doubtful or rejected, and a script must
not go on with its numbers; 2 the input is faulty (one sentence a fault on standard error, no traceback);
130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code.

    Parameters
    ----------
    arguments
        Words after ``rsgen``; those of the process by default.

    Raises
    ------
    SystemExit
        Always, with the exit code.
    """
    # nothing is imported above: Ctrl-C during an import would show a traceback
    try:
        from rsgen.app.cli.application import run_program

        run_program(arguments)
    except KeyboardInterrupt:
        sys.stderr.write("rsgen: interrupted; nothing half-written was left\n")
        sys.exit(130)
