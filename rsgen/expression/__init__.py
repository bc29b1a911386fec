"""The expression language of rsgen: text to SymPy by an allow-list, and back to text.

``parse`` reads a force law or a formula without ever evaluating its text, ``write`` gives text that
``parse`` reads back, ``symbol`` is the one place where symbols are made, and ``check_name`` decides which
names parameters may have.
"""

from rsgen.expression.names import check_name, symbol
from rsgen.expression.reading import parse
from rsgen.expression.writing import write

__all__ = ["check_name", "parse", "symbol", "write"]
