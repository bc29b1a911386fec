"""A draft of a case, read as a user reads it who has entered what it asks for."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from rsgen.app.cli.inspect_command import proposal_text
from rsgen.cases import load_case
from rsgen.data.surface import ResponseSurface
from rsgen.files import MeasuredTest, read_measurement
from rsgen.files.inspection import Proposal, list_contents, propose

__all__ = ["drafted", "read_draft"]


def drafted(path: Path) -> Proposal:
    """Return the draft for a file."""
    proposal = propose(list_contents(path))
    assert proposal is not None
    return proposal


def read_draft(
    path: Path, **entered: dict[str, Any]
) -> tuple[dict[str, Any], ResponseSurface, dict[str, str]]:
    """Return the [test] tables of a draft, what they read, and its comments.

    Parameters
    ----------
    path
        A measured file.
    entered
        By table of the case ("test", "response"): keys that the user enters or changes.
    """
    proposal = drafted(path)
    places = {("test" if name == "test" else f"test.{name}"): keys for name, keys in entered.items()}
    tables = proposal.tables | {name: proposal.tables.get(name, {}) | keys for name, keys in places.items()}
    text = proposal_text(replace(proposal, tables=tables)).replace('"? N"', '"1 N"')
    text = text.replace('excitation = "?"', 'excitation = "swept-sine"')
    law = "name = 'a'\ntitle = 'a'\nschema = 1\n[[element]]\nname = 'a'\nforce = 'k*x + c*v'\n"
    case = path.with_name("draft.toml")
    case.write_text(law + text, encoding="utf-8")
    test = load_case(case).test
    assert isinstance(test, MeasuredTest)
    surface = read_measurement(test)
    assert isinstance(surface, ResponseSurface)
    return tomllib.loads(text)["test"], surface, proposal.doubts
