"""Tables of an oscillator at two levels, and drafts of a case, read as a user reads them."""

import random
import tomllib
from dataclasses import replace

import numpy as np

from rsgen import ResponseSurface, load_case
from rsgen.app.cli.inspect_command import proposal_text
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import Proposal, propose
from rsgen.files.plan import MeasuredTest

MASS, DAMPING, STIFFNESS = 1.5, 4.0, 6000.0
FREQUENCY = np.linspace(6.0, 14.0, 17)
OMEGA = 2 * np.pi * FREQUENCY
LEVELS = (1.0, 3.0)


def receptance(frequency: np.ndarray) -> np.ndarray:
    omega = 2 * np.pi * frequency
    return 1 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)


RECEPTANCE = receptance(FREQUENCY)


def write_levels(path, columns, delimiter=";", seed=None):
    """Write a row a frequency and level; with a seed the columns are in an order of chance."""
    blocks = [columns(level) for level in LEVELS]
    titles = list(blocks[0])
    if seed is not None:
        random.Random(seed).shuffle(titles)
    tables = [np.broadcast_arrays(*(block[title] for title in titles)) for block in blocks]
    rows = np.hstack(tables).T
    head = delimiter.join(titles)
    np.savetxt(path, rows, "%.9g", delimiter=delimiter, header=head, comments="", encoding="utf-8")
    return path


def write_table(path, head, values, delimiter=",", seed=None):
    """Write levels of a table whose titles ``head`` has between commas; the first is of the frequency."""
    titles = head.split(",")
    return write_levels(
        path, lambda level: dict(zip(titles, (FREQUENCY, *values(level)), strict=True)), delimiter, seed
    )


def is_receptance(surface: ResponseSurface, factor=1.0) -> bool:
    """Decide whether response over force is the receptance of the oscillator, times a factor."""
    exact = factor * receptance(surface.frequency)
    return np.allclose(surface.harmonics[:, 1] / surface.force, exact, rtol=1e-6, atol=0)


def drafted(path) -> Proposal:
    proposal = propose(list_contents(path))
    assert proposal is not None
    return proposal


def read_draft(path, **entered: dict):
    """Return the [test] tables of a draft, what they read, and its comments.

    ``entered`` are keys that the user enters or changes, by table of the case ("test", "response").
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
