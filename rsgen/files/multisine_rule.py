"""How records of a periodic multisine are read: a part of the plan of time histories."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rsgen.common.declaration import check, declare, documented, given
from rsgen.common.errors import MeasurementError

__all__ = ["FROM_RECORDS", "MultisineRule", "multisine_faults"]


@documented
@dataclass(frozen=True, slots=True)
class MultisineRule:
    """The periods of a multisine, where they are not to be found from the records."""

    period: int | None = declare(
        None, "Samples a period; found from the force without.", at_least=16, at_most=100_000_000
    )
    transient: int | None = declare(
        None,
        "Periods left out at the beginning of each record; found from the response without.",
        at_least=0,
        at_most=1_000_000,
    )

    def __post_init__(self) -> None:
        check(self, MeasurementError)


FROM_RECORDS = MultisineRule()
"""Everything is found from the records."""


def multisine_faults(history: object, excitation: str, rule: MultisineRule) -> Iterator[tuple[str, str]]:
    """Find keys of a history that belong to another excitation: a key, and what is wrong with it."""
    many = excitation == "multisine"
    if not many and given(rule, "period", "transient"):
        yield "multisine", "belongs to excitation = 'multisine'; leave it out"
    if many and given(history, "band", "law", "bandwidth", "harmonics"):
        yield "demodulation", "belongs to sines; of a multisine identify.band chooses the lines"
