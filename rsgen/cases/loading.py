"""A case file to a case, every fault at once."""

from __future__ import annotations

import os
from copy import deepcopy
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rsgen.cases.building import build
from rsgen.cases.case import Case
from rsgen.cases.document import CaseDocument
from rsgen.cases.faults import KINDS, sentences
from rsgen.cases.toml_tree import parse_case, read_text
from rsgen.common.errors import CaseError, RsgenError, quote
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface, load_surface
from rsgen.files import MeasuredTest, read_measurement

__all__ = ["DATA_VARIABLE", "load_case", "read"]

DATA_VARIABLE = "RSGEN_DATA"
"""Environment variable: the folder where measured files are looked for before the case's own folder."""


def _folders(path: Path, data: str | os.PathLike[str] | None) -> tuple[Path, ...]:
    if data is not None:
        return (Path(data),)
    variable = os.environ.get(DATA_VARIABLE)
    return (Path(variable), path.parent) if variable else (path.parent,)


def _further_faults(tree: dict[str, Any], error: ValidationError, folders: tuple[Path, ...]) -> list[str]:
    """Say what else is wrong where the faulty entries can be left out without making new faults."""
    rest = deepcopy(tree)
    for fault in error.errors(include_url=False):
        *path, key = fault["loc"]
        table: Any = rest
        if fault["type"] != "extra_forbidden" and path != ["accept"]:
            return []
        for part in path:
            # the discriminator's tag is no key of the file
            if not (isinstance(table, dict) and part in KINDS and part not in table):
                table = table[part]
        table.pop(key, None)
    try:
        build(CaseDocument.model_validate(rest), Path(), "", folders)
    except ValidationError:
        return []
    except CaseError as further:
        return list(further.faults)
    return []


def load_case(path: str | os.PathLike[str], data: str | os.PathLike[str] | None = None) -> Case:
    """Read and check a case file.

    Parameters
    ----------
    path
        The TOML file.
    data
        The folder of the measured file; default is the folder that RSGEN_DATA names, then the case's own.

    Returns
    -------
    Case
        Everything a run needs. The data file of a measured case is not opened yet.

    Raises
    ------
    CaseError
        Anything wrong with the file; ``faults`` holds one line ``file: path.to.key: what; what is allowed``
        for each.
    """
    file = Path(path)
    folders = _folders(file, data)
    try:
        text = read_text(file)
        tree = parse_case(text)
        try:
            document = CaseDocument.model_validate(tree)
        except ValidationError as error:
            found = sentences(error, CaseDocument)
            raise CaseError([*found, *_further_faults(tree, error, folders)]) from None
        return build(document, file, text, folders)
    except CaseError as error:
        label = file.name if file.name.isprintable() else quote(file.name)
        raise CaseError(f"{label}: {fault}" for fault in error.faults) from error.__cause__


def read(
    source: str | os.PathLike[str] | Case | MeasuredTest, data: str | os.PathLike[str] | None = None
) -> ResponseSurface | MultisineSpectra:
    """Read a response surface.

    Parameters
    ----------
    source
        A measured test, a measured case or its file, or a surface that rsgen saved (.h5).
    data
        As for ``load_case``.

    Raises
    ------
    RsgenError
        The case is simulated (``simulate`` computes its surface), or a file cannot be read.
    """
    if isinstance(source, str | os.PathLike):
        if Path(source).suffix.lower() == ".h5":
            return load_surface(source)
        if Path(source).suffix.lower() != ".toml":
            raise RsgenError(
                f"{Path(source).name}: not a case (.toml) or a surface that rsgen saved (.h5); "
                "rsgen init --from DATA CASE.toml writes the case of a file"
            )
        source = load_case(source, data)
    test = source.test if isinstance(source, Case) else source
    if isinstance(test, MeasuredTest):
        return read_measurement(test)
    raise RsgenError("the case is simulated and has no file to read; rsgen.simulate computes its surface")
