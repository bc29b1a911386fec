"""What a data file holds, and a guess of the case that would read it."""

from __future__ import annotations

from rsgen.inspection.listing import list_contents
from rsgen.inspection.proposal import Proposal, propose
from rsgen.measurement.tree import Contents, Entry

__all__ = ["Contents", "Entry", "Proposal", "list_contents", "propose"]
