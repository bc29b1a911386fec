"""The formula language of rsgen: text to SymPy by an allow-list, and back; units are in ``units``.

``reading.parse`` reads a force law or a formula without ever evaluating its text, ``printing.write`` gives
text that ``parse`` reads back, ``names.symbol`` is the one place where symbols are made, and
``names.check_name`` decides which names parameters may have.
"""
