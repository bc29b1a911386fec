"""Tables as laboratories write them, and plans to read them."""

import numpy as np

from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import MeasuredTest
from rsgen.files.signals import Channel


def write_columns(path, titles: str, *columns):
    """Write columns below their titles, if there are any; a single number stands in every row."""
    rows = np.column_stack(np.broadcast_arrays(*columns))
    np.savetxt(path, rows, "%.17g", delimiter=",", header=titles, comments="")
    return path


def planned(files, frequency=1, force=2, response=3, **more) -> MeasuredTest:
    """Plan to read displacements, without phases unless said; a name or number is a column of amplitudes."""
    force, response = (Channel(amplitude=c) if isinstance(c, int | str) else c for c in (force, response))
    known = {"quantity": "displacement", "phase_known": False}
    return MeasuredTest(files, frequency, force, response, **known | more)


def read_planned(*words, **more):
    """Return what ``planned`` of the same arguments reads."""
    return read_measurement(planned(*words, **more))


def doubts(surface) -> list[str]:
    """Return the codes of what is doubted."""
    return [finding.code for finding in surface.findings if finding.severity == "doubt"]
