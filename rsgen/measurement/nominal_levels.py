"""To which level each point belongs."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.measurement.address import show
from rsgen.measurement.data_files import file_label
from rsgen.measurement.plan import MeasuredTest
from rsgen.surface.directions import group_forces

__all__ = ["group_levels", "level_of_file"]

_NUMBER = r"([+-]?\d{1,30}(?:[.,]\d{1,30})?(?:[eE][+-]?\d{1,3})?)"


def group_levels(force: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
    """Group like forces to levels: in ascending order, a gap of more than ``spread`` begins a new level.

    Parameters
    ----------
    force
        (n,) amplitude of the measured force [N], positive.
    spread
        Relative gap.

    Returns
    -------
    (n,) the median force of each point's group [N].

    Examples
    --------
    >>> import numpy as np
    >>> group_levels(np.array([1.0, 1.02, 2.0, 0.99]), 0.1).tolist()
    [1.0, 1.0, 2.0, 1.0]
    """
    group = group_forces(force, spread)
    return np.array([np.median(force[group == number]) for number in range(int(group.max()) + 1)])[group]


def level_of_file(test: MeasuredTest, number: int) -> float | None:
    """Find the level of a file in the plan or its name [N]; None where its points differ in level.

    Raises
    ------
    MeasurementError
        The name does not have the form that the plan says, or the number is not above 0.
    """
    rule = test.level
    if rule.value is not None:
        return rule.value
    if rule.values and len(rule.values) == len(test.files):
        return rule.values[number]
    if rule.name is None:
        # several values for one file belong to its entries
        return None
    name = test.files[number].name
    before, _, after = rule.name.partition("{level}")
    match = re.fullmatch(re.escape(before) + _NUMBER + re.escape(after), name)
    if match is None:
        raise MeasurementError(
            f"{file_label(test.files[number])}: its name is not of the form {show(rule.name)}"
        )
    level = float(match[1].replace(",", ".")) * test.level_factor
    if not level > 0:
        raise MeasurementError(
            f"{file_label(test.files[number])}: its name gives a level of {level:g} N; above 0 needed"
        )
    return level
