"""Case files: TOML to the objects of rsgen, every fault at once; the only place that knows pydantic."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import sympy
from pydantic import ValidationError

from rsgen.case.building import build
from rsgen.case.document import CaseDocument, case_schema
from rsgen.case.faults import sentences
from rsgen.case.naming import quote
from rsgen.case.toml_tree import parse_case, read_text
from rsgen.errors import CaseError
from rsgen.measurement import MeasuredTest
from rsgen.oscillator import Model, Oscillator
from rsgen.simulation import SimulatedTest

__all__ = ["DATA_VARIABLE", "Case", "case_schema", "find_cases", "load_case", "name_clashes"]

DATA_VARIABLE = "RSGEN_DATA"
"""Environment variable: the folder where measured files are looked for before the case's own folder."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A structure, a test, what to identify and how well: one case file, checked.

    Parameters
    ----------
    path
        The case file.
    name, title, source
        Folder of the report, heading, origin; printable text, never markup.
    text, sha256
        The file's text and the SHA-256 of its bytes as UTF-8.
    oscillator
        The structure with its true values; None for a measured case.
    model
        The laws without values, all that identification gets.
    test
        How the response surface comes about.
    truth
        True values in SI by parameter, "m" [kg] included; None for a measured case.
    accept
        Largest relative error of the refined estimate, by parameter, "m" or "stiffness_force",
        "damping_force".
    printed
        "stiffness", "damping": formulas as the source prints them, in X, X0, omega and the parameters.
    units
        SI unit of each parameter and of "m"; "" where the law does not tell it.
    warnings
        Sentences about what is allowed but may be meant otherwise.
    ranked
        Whether the laws of the library compete with the case's own.
    """

    path: Path
    name: str
    title: str
    source: str
    text: str
    sha256: str
    oscillator: Oscillator | None
    model: Model
    test: SimulatedTest | MeasuredTest
    truth: Mapping[str, float] | None
    accept: Mapping[str, float] = field(default_factory=dict)
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    ranked: bool = False

    def with_model(self, model: Model) -> Case:
        """Give the case the law that a ranking found; what concerned another law is left out.

        Parameters
        ----------
        model
            Of the best candidate; the case's own one leaves the case as it is.
        """
        if model.elements == self.model.elements:
            return self
        units = {name: unit for name, unit in self.units.items() if name == "m"}
        return replace(self, model=model, truth=None, printed={}, units=units)


def _folders(path: Path, data: str | os.PathLike[str] | None) -> tuple[Path, ...]:
    if data is not None:
        return (Path(data),)
    variable = os.environ.get(DATA_VARIABLE)
    return (Path(variable), path.parent) if variable else (path.parent,)


def _document(tree: dict[str, Any], label: str, folders: tuple[Path, ...]) -> CaseDocument:
    try:
        return CaseDocument.model_validate(tree)
    except ValidationError as error:
        faults = [*sentences(error), *_further_faults(tree, error, folders)]
        raise CaseError(f"{label}: {fault}" for fault in faults) from None


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
            if not (isinstance(table, dict) and part in ("simulated", "measured") and part not in table):
                table = table[part]
        table.pop(key, None)
    try:
        return build(CaseDocument.model_validate(rest), folders).faults
    except ValidationError:
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
    label = file.name if file.name.isprintable() else quote(file.name)
    text = read_text(file)
    folders = _folders(file, data)
    document = _document(parse_case(text, label), label, folders)
    parts = build(document, folders)
    if parts.faults or parts.model is None or parts.test is None:
        raise CaseError(f"{label}: {fault}" for fault in parts.faults)
    return Case(
        path=file,
        name=document.name,
        title=document.title,
        source=document.source,
        text=text,
        sha256=hashlib.sha256(text.encode("utf-8")).hexdigest(),
        oscillator=parts.oscillator,
        model=parts.model,
        test=parts.test,
        truth=parts.truth,
        accept=parts.accept,
        printed=parts.printed,
        units=parts.units,
        warnings=tuple(parts.warnings),
        ranked=document.model == "rank",
    )


def find_cases(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """List the case files that paths name: files as they are, folders by their ``*.toml``, sorted.

    Raises
    ------
    CaseError
        A path does not exist, or a folder has no case.
    """
    found: list[Path] = []
    faults: list[str] = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = sorted(path.glob("*.toml"), key=lambda file: file.stem)
            if not inside:
                faults.append(f"{quote(path, 200)}: has no case file; a folder with *.toml is needed")
            found += inside
        elif path.exists():
            found.append(path)
        else:
            near = get_close_matches(path.name, [file.name for file in path.parent.glob("*.toml")], 1)
            hint = f"; did you mean {quote(path.with_name(near[0]), 200)}?" if near else ""
            faults.append(
                f"{quote(path, 200)}: does not exist; a case file or a folder of cases is needed{hint}"
            )
    if faults:
        raise CaseError(faults)
    return list(dict.fromkeys(found))


def name_clashes(cases: Iterable[Case]) -> dict[Path, str]:
    """Find cases that would share a folder of results, capitals ignored: a sentence for all but the first."""
    first: dict[str, Case] = {}
    clashes: dict[Path, str] = {}
    for case in cases:
        other = first.setdefault(case.name.casefold(), case)
        if other is not case:
            clashes[case.path] = (
                f"{case.path.name}: name: {quote(case.name)} is also the name of {other.path.name}; "
                "names must differ by more than capitals"
            )
    return clashes
