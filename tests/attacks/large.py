"""A surface of a million points: simulated and saved by one process, loaded by another.

``python -m tests.attacks large``
"""

from __future__ import annotations

import json
import subprocess
import sys

from tests.attacks.program import Row, environment, row, temporary

SIDE = 1000
"""Levels, and frequencies a level."""

ASKED = "8.3 s, 593 MB; 1.7 s"
"""What the surface took before readers and folders were guarded, on the machine of the issue."""

SIMULATED = """
import sys, numpy as np, rsgen as rs
side = int(sys.argv[2])
truth = rs.Oscillator(1.5, "k*x + k3*x**3 + c*v", {"k": 6000.0, "k3": 2e5, "c": 8.0})
test = rs.SimulatedTest(level=np.linspace(1, 10, side), frequency=np.linspace(8, 12, side), harmonics=1)
rs.save_surface(sys.argv[1], rs.simulate(truth, test))
"""
LOADED = """
import sys, rsgen as rs
surface = rs.load_surface(sys.argv[1])
assert len(surface) == int(sys.argv[2]) ** 2 and surface.settled.mean() > 0.99
"""
STARTED = "started, worked = time.perf_counter(), time.process_time()\n"
MEASURED = """
import json, resource, time
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps([time.perf_counter() - started, time.process_time() - worked, used.ru_maxrss / 1024]))
"""


def measure(program: str, *words: str, around: dict[str, str]) -> str:
    """Run a program in a new process; say its seconds after the imports, and the largest memory."""
    first, rest = program.strip().split("\n", 1)
    text = f"import time\n{first}\nrs.simulate, rs.load_surface\n{STARTED}{rest}{MEASURED}"
    done = subprocess.run(
        [sys.executable, "-c", text, *words], capture_output=True, text=True, check=True, env=around
    )
    seconds, worked, megabytes = json.loads(done.stdout)
    return f"{seconds:.1f} s ({worked:.1f} s of the processor), {megabytes:.0f} MB"


def run(count: int, seed: int) -> list[Row]:
    """Simulate, save and load ``count`` points."""
    side = max(2, round(count**0.5))
    with temporary() as place:
        file, around = str(place / "surface.h5"), environment(place)
        # compiled before
        measure(SIMULATED, file, "20", around=around)
        simulated = measure(SIMULATED, file, str(side), around=around)
        loaded = measure(LOADED, file, str(side), around=around)
    return [
        row(
            f"surface of {side**2} points simulated and saved; loaded",
            ASKED,
            f"{simulated}; {loaded}",
        )
    ]
