"""What rsgen says when it cannot go on: where, what is wrong, what is allowed."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["CaseError", "ExpressionError", "MeasurementError", "RsgenError", "UnknownNameError"]


class RsgenError(Exception):
    """A fault of the input, in a sentence that names place, fault and what is allowed."""


class UnknownNameError(RsgenError, KeyError):
    """Nothing has the name that was asked for; also a ``KeyError``."""

    def __str__(self) -> str:
        """Give the message as it is; a KeyError would quote it."""
        return str(self.args[0])


class ExpressionError(RsgenError):
    """A formula is not in the expression language, or a force law cannot be used as asked."""


class MeasurementError(RsgenError):
    """A measured file cannot be read as the case describes it."""


class CaseError(RsgenError):
    """A case file is faulty; all its faults are reported at once.

    Attributes
    ----------
    faults
        One line a fault, each ``file: path.to.key: what is wrong; what is allowed``.
    """

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(self.faults))
