"""From a test to parameters with intervals; the truth is never seen.

``fitting`` is the least squares, ``starting`` its initial values, ``results`` what comes out; ``lines`` is
the same for multisines, ``modal_table`` a mode without a law, ``ranking`` the choice among laws,
``prediction`` what a result says of other levels, held-out ones among them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.identification.profile import with_profiles

__all__ = ["with_profiles"]

# most laws are linear in their parameters
__getattr__ = on_first_use(__name__, {"with_profiles": "profile"})
