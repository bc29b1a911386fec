"""What a process settles before it works."""

import subprocess
import sys

_ENDING = """
import sys
from rsgen.common import process

class Cycle:
    def __init__(self):
        self.me = self

    def __del__(self, write=sys.__stdout__.write):
        write("searched")

getattr(process, sys.argv[1])()
kept = Cycle()
"""


def _printed(*words: str) -> str:
    done = subprocess.run([sys.executable, "-c", _ENDING, *words], capture_output=True, text=True, check=True)
    return done.stdout


def test_nothing_is_searched_for_cycles_at_the_exit():
    assert _printed("collect_seldom") == "searched"
    assert _printed("leave_at_once") == ""
