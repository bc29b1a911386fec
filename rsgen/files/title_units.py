"""Whether a case reads a column in the unit that its title names."""

from __future__ import annotations

from collections.abc import Mapping

from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.files.column_titles import unit_in
from rsgen.files.plan import MeasuredTest, Signal
from rsgen.formula.units import quantity, sensor_unit

__all__ = ["contradiction", "unit_doubts"]

_SAME_UNIT = 1e-3
"""Units closer than this, relatively, are one: 9.81 and 9.80665 m/s^2 for g."""


def contradiction(file: str, column: str, unit: str, title: str) -> Finding:
    """Say that the case reads a column in another unit than its title names."""
    about = {"file": file, "column": column, "unit": unit, "title": title}
    return Finding("unit-contradicts-title", "doubt", names=about)


def unit_doubts(
    test: MeasuredTest, file: str, titles: Mapping[int | str, str], signal: Signal | None, target: str
) -> list[Finding]:
    """Find columns whose title names another unit of the same quantity than the case.

    Parameters
    ----------
    test, file
        The plan, and what the file is called.
    titles
        Of the columns, by their addresses.
    signal
        Force or response; None where there is none.
    target
        Its SI unit.
    """
    if signal is None or signal.unit is None or signal.factor != 1 or not test.calibrated:
        return []
    found = []
    for column in signal.columns:
        title = unit_in(titles.get(column, ""))
        try:
            said, read = (
                quantity(f"1 {sensor_unit(u, target)}", target) for u in (title or target, signal.unit)
            )
        except RsgenError:
            # a title may end like a unit of something else
            continue
        if title and abs(said - read) > _SAME_UNIT * abs(read):
            found.append(contradiction(file, titles.get(column, str(column)), signal.unit, title))
    return found
