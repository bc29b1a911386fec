"""The formula language of rsgen: text to SymPy by an allow-list, and back to text; units are in ``units``.

``parse`` reads a force law or a formula without ever evaluating its text, ``write`` gives text that
``parse`` reads back, ``symbol`` is the one place where symbols are made, and ``check_name`` decides which
names parameters may have.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.formula.names import check_name, symbol
    from rsgen.formula.printing import write
    from rsgen.formula.reading import parse

__all__ = ["check_name", "parse", "symbol", "write"]

# units are read without the library of algebra
__getattr__ = on_first_use(
    __name__, {"check_name": "names", "parse": "reading", "symbol": "names", "write": "printing"}
)
