"""Programs of their own process that tests start: Python, and the command line of rsgen."""

import os
import subprocess
import sys
from pathlib import Path

RSGEN = [sys.executable, "-c", "from rsgen.app.cli import main; main()"]


def start(*words: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    known = {"capture_output": True, "text": True, "timeout": 120, "check": False}
    return subprocess.run([*map(str, words)], **known | options)


def python(*words: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    return start(sys.executable, *words, **options)


def shell(*words: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run rsgen in an environment that has more variables."""
    return start(*RSGEN, *words, env={**os.environ, **environment})
