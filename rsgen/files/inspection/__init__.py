"""List the contents of a data file, and draft a case that reads it."""

from __future__ import annotations

from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import Proposal, propose
from rsgen.files.tree import Contents, Entry

__all__ = ["Contents", "Entry", "Proposal", "list_contents", "propose"]
