"""From a response surface and laws without values to parameters with intervals; truth is never seen."""

from __future__ import annotations

from rsgen.identification.identify import identify

__all__ = ["identify"]
