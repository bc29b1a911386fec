"""From a test to parameters with intervals; the truth is never seen.

``fitting`` is the least squares, ``starting`` its initial values, ``results`` what comes out; ``lines`` is
the same for multisines, ``modal_table`` a mode without a law, ``ranking`` the choice among laws,
``prediction`` what a result says of other levels, held-out ones among them.
"""
