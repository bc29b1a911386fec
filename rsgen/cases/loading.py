"""A case file to a case, every fault at once."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Iterable, Mapping
from copy import deepcopy
from dataclasses import replace
from math import isnan, prod
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import sympy
from pydantic import ValidationError

import rsgen.files
from rsgen.cases.case import VIRTUAL_TESTS, Case, CaseDocument, Document, ElementTable, make_measured
from rsgen.cases.faults import KINDS, name_fault, open_places, parse_case, read_text, sentences, text_fault
from rsgen.cases.tables import MAX_POINTS, Maker
from rsgen.common.errors import (
    CaseError,
    ExpressionError,
    RsgenError,
    listed,
    near_file,
    one_line,
    quote,
    require,
    shown_path,
    suggest,
)
from rsgen.common.finding import Finding, Quantity
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import KNOWN_MASS, Model, Observation, Oscillator, total_force
from rsgen.data.record_set import BASE_UNITS, PlannedTest, match_level
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.virtual_test import SimulatedTest, VirtualTest
from rsgen.files.plan import MeasuredTest
from rsgen.formula.names import check_name, symbol
from rsgen.formula.printing import write
from rsgen.formula.reading import parse
from rsgen.formula.unit_deduction import parameter_units, unit_faults
from rsgen.formula.units import quantity, unit_of
from rsgen.law.element import Element, laws, make_element
from rsgen.law.memory import force_keys, memory_form

# ----------------------------------------------------------------------------
# Lists of case files, and cases that cannot be run into one folder.


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
                faults.append(f"{shown_path(path)}: has no case file; a folder with *.toml is needed")
            found += inside
        elif path.exists():
            found.append(path)
        else:
            needed = f"a case file or a folder of cases is needed{near_file(path, '.toml')}"
            faults.append(f"{shown_path(path)}: does not exist; {needed}")
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
                f"{shown_path(case.path)}: name: {quote(case.name)} is also the name of "
                f"{shown_path(other.path)}; names must differ by more than capitals"
            )
    return clashes


# ----------------------------------------------------------------------------
# The tables [test] of a virtual test and [identify] to the test and its observation.


def make_simulated(table: Any, maker: Maker) -> VirtualTest:
    """Make a virtual test; a grid has at most a million points."""
    base = getattr(table, "base", None)
    if base is not None and base.quantity is not None:
        maker.units = {"N": BASE_UNITS[base.quantity]}
    kind, _ = VIRTUAL_TESTS[table.kind]
    if kind is not SimulatedTest:
        return maker.make(kind, table, "test")
    if table.control in ("response", "continuation"):
        maker.units = {"N": "m"}
    test = maker.make(SimulatedTest, table, "test")
    rows = ((table.level, test.level), (table.frequency, test.frequency))
    sizes = [size for grid, row in rows if (size := grid.count if row is None else len(row)) is not None]
    if prod(sizes) > MAX_POINTS:
        shown = " x ".join(map(str, sizes))
        maker.faults.append(f"test: {shown} = {prod(sizes)} points; at most {MAX_POINTS} in a case")
    return test


def make_observation(table: Any, test: PlannedTest, maker: Maker) -> Observation:
    """Make the observation; levels held out of a virtual test must be among those tested."""
    observation = maker.make(Observation, table, "identify", predict=())
    unit, control = maker.units.get("N", "N"), getattr(test, "control", "force")
    base = getattr(test, "base", None)
    of_drive = maker
    if unit and control in ("response", "continuation"):
        # levels are amplitudes of the response, but predictions are of what drives it
        of_drive = replace(maker, units=maker.units | {"N": "m/s^2" if base else "N"})
    asked = SimpleNamespace(predict=getattr(table, "predict", None))
    predict = of_drive.make(Observation, asked, "identify").predict
    if isinstance(test, MeasuredTest) and test.level.labels:
        maker.faults += [
            f"identify.predict.{number}: {value:g} has no unit, and the levels are labels; "
            f'a force is needed, such as "{value:g} N"'
            for number, value in enumerate(asked.predict or (), start=1)
            if not isinstance(value, str)
        ]
    planned, levels = test.planned_levels, list[float]()
    for number, level in enumerate(observation.hold_out, start=1):
        if isnan(level):
            continue
        place = f"identify.hold_out.{number}"
        if len(planned):
            meant = match_level(planned, level)
            if meant is None:
                tested = listed([f"{one:g}" for one in planned])
                maker.faults.append(f"{place}: {level:g} {unit} is not tested; test.level has {tested}")
                continue
            level = meant
        if level in levels:
            maker.faults.append(f"{place}: {level:g} {unit or 'N'} stands twice; each level once")
            continue
        levels.append(level)
    if levels and len(levels) == len(planned):
        maker.faults.append("identify.hold_out: holds every level back; at least one must remain")
    moved = getattr(base, "quantity", base) in ("displacement", "velocity")
    if predict and (moved or control == "phase"):
        held = "a base whose displacement or velocity is the level" if moved else "a lag that is held"
        maker.faults.append(
            f"identify.predict: forces or accelerations of a base are needed; of {held} use rsgen.predict"
        )
    return observation if maker.faults else replace(observation, hold_out=tuple(levels), predict=predict)


# ----------------------------------------------------------------------------
# From the checked document to the case; faults that concern several keys are found here.

MASS = "m"


def _make(table: ElementTable) -> Element:
    """Make a spring or damper from its formula, or from a law of the library."""
    if table.law is not None:
        if table.memory:
            raise RsgenError("'memory' belongs to a 'force'; a law of the library has its own")
        return laws[table.law].element(table.name, table.parameters)
    if table.force is None:
        raise RsgenError("is missing; a formula in x and v, or 'law' with the name of a law (rsgen laws)")
    if table.parameters:
        raise RsgenError("'parameters' renames those of a 'law'; a formula names its own")
    return make_element(table.name, table.force, table.memory)


def _key(name: str) -> str:
    return name if name.isidentifier() and len(name) <= 40 else quote(name)


def _unknown(name: str, known: Collection[str]) -> str:
    listed = f"known: {', '.join(known) or 'none'}"
    if name == MASS:
        return f"is the mass; it stands in [system]; {listed}"
    try:
        check_name(name)
    except ExpressionError as fault:
        return one_line(fault)
    return f"is no parameter of the elements; {suggest(name, known)}{listed}"


class _Builder:
    """Collects faults while the parts of a document, its shapes checked, are built one after the other.

    Measured files are looked for in the ``folders``, in this order.
    """

    def __init__(self, document: Document, folders: tuple[Path, ...]) -> None:
        self.document = document
        self.maker = Maker(folders)
        self.faults = self.maker.faults
        self.units_fit = True
        self.simulated = document.test.kind != "measured"

    def fault(self, place: str, text: str) -> None:
        self.faults.append(f"{place}: {text}")

    def texts(self) -> None:
        document = self.document
        if fault := name_fault(document.name):
            self.fault("name", fault)
        for key in ("title", "source"):
            text = getattr(document, key)
            if (text or key == "title") and (fault := text_fault(text)):
                self.fault(key, fault)

    @property
    def tables(self) -> list[ElementTable]:
        """The elements of the file; of a ranking without any, spring and damper that all candidates have."""
        document = self.document
        if document.element is not None:
            return document.element
        if document.model == "rank" and not self.simulated:
            return [ElementTable(name=name, law=name) for name in ("linear-spring", "linear-damper")]
        return []

    def elements(self) -> tuple[Element, ...]:
        if not self.tables:
            self.fault("element", 'is missing; every case needs it, but a measured one with model = "rank"')
        built = []
        taken: set[str] = set()
        for number, table in enumerate(self.tables, start=1):
            place = f"element.{number}"
            if fault := name_fault(table.name):
                self.fault(f"{place}.name", fault)
            elif table.name.casefold() in taken:
                self.fault(f"{place}.name", f"{quote(table.name)} is used twice; names must be unique")
            taken.add(table.name.casefold())
            key = "force" if table.law is None else "law"
            if table.law is not None and table.force is not None:
                self.fault(place, "has 'force' and 'law'; one of them says the law")
                continue
            try:
                element = _make(table)
            except RsgenError as error:
                text = one_line(error)
                # what is wrong with an equation says its own key
                self.faults.append(f"{place}.{text if text.startswith('memory.') else f'{key}: {text}'}")
                continue
            if MASS in element.parameters:
                self.fault(f"{place}.{key}", "'m' is the mass; name the parameter otherwise")
            built.append(replace(element, across=table.across or ""))
        return tuple(built)

    def parameters(self, elements: tuple[Element, ...]) -> dict[str, str]:
        """Return the unit of every parameter, and note where its dimension contradicts itself."""
        force = total_force(elements)
        try:
            # states of one name in two elements, or a state with the name of another's parameter
            memory_form(force)
            units = dict(parameter_units(force))
        except RsgenError as fault:
            self.fault("element", one_line(fault))
            self.units_fit = False
            units = {}
        names = sorted({name for element in elements for name in element.parameters})
        return {name: units.get(name, "") for name in names}

    def values(
        self, place: str, table: Mapping[str, Any], elements: tuple[Element, ...], units: dict[str, str]
    ) -> dict[str, float]:
        """Turn values of parameters into SI; their units must make every term of the law a force."""
        states = {name for element in elements for name in element.memory}
        terms = sympy.Add.make_args(total_force(elements))
        values: dict[str, float] = {}
        for name, value in table.items():
            if name not in units:
                why = f"is a state; it is 0 at the start, known: {', '.join(units)}"
                self.fault(f"{place}.{_key(name)}", why if name in states else _unknown(name, units))
                continue
            try:
                values[name] = quantity(value, units[name] or None)
            except RsgenError as fault:
                of_dimension = units[name] and "needed" in str(fault)
                term = next((part for part in terms if part.has(symbol(name))), None)
                why = f"; {write(term)} must be a force" if of_dimension and term is not None else ""
                self.fault(f"{place}.{name}", f"{one_line(fault)}{why}")
        return values

    def truth(self, elements: tuple[Element, ...], units: dict[str, str]) -> dict[str, float]:
        """Turn every true value into SI; each parameter needs one."""
        before = len(self.faults)
        table = self.document.truth or {}
        values = self.values("truth", table, elements, units)
        for number, element in enumerate(elements, start=1):
            for name in element.parameters:
                if name not in table and name != MASS:
                    known = f"known: {', '.join(sorted(k for k in table if k in units)) or 'none'}"
                    neither = f"has neither a value in [truth] nor an equation in element.{number}.memory"
                    self.fault(f"element.{number}", f"{quote(name)} {neither}; {known}")
        if len(self.faults) == before and self.units_fit:
            # where the law alone does not determine the units, those of the values must at least fit together
            given = {name: unit_of(value) for name, value in table.items()}
            contradictions = unit_faults(
                total_force(elements), {name: unit for name, unit in given.items() if unit}
            )
            self.faults += [f"truth: {sentence}" for sentence in contradictions]
        return values

    def fixed(self, elements: tuple[Element, ...], units: dict[str, str]) -> dict[str, float]:
        """Turn values that are not identified into SI."""
        table = getattr(self.document.identify, "fixed", {})
        if table and self.document.model == "rank":
            self.fault("identify.fixed", "the law is not known before a ranking; a mass stands in [system]")
        return self.values("identify.fixed", table, elements, {**units, MASS: "kg"})

    def mass(self) -> float | None:
        value = self.document.system.mass
        if isinstance(value, str) and re.search(r"±|\+/?-", value):
            error = re.search(r"(?:±|-)\s*(\d+(?:\.\d+)?)\)?\s*([A-Za-z]+)\s*\Z", value)
            half = f', as mass_error = "{float(error[1]) / 2:g} {error[2]}"' if error else ""
            self.fault(
                "system.mass",
                f"{quote(value)} has an error; its standard error, half of a ± that holds for 95 %, stands "
                f"under mass_error{half}",
            )
        elif value is not None:
            return self.maker.number("system.mass", value, KNOWN_MASS)
        elif self.simulated:
            self.fault("system.mass", 'is missing; a simulated case needs a mass such as "1.5 kg"')
        return None

    def mass_error(self) -> float | None:
        value = self.document.system.mass_error
        if value is None:
            return None
        if self.simulated or self.document.system.mass is None:
            why = "of a simulated case the mass is the truth" if self.simulated else "no mass is given"
            self.fault("system.mass_error", f"{why}; leave the error out")
            return None
        return self.maker.number("system.mass_error", value, KNOWN_MASS)

    def across(self) -> str | None:
        """Between which channels elements act; one pair in a case, none in one that is simulated."""
        said = {table.across: number for number, table in reversed([*enumerate(self.tables, start=1)])}
        said.pop(None, None)
        for other, number in list(said.items())[: None if self.simulated else -1]:
            several = f"{quote(str(other))}; one sum of channels is allowed in a case"
            alone = "a simulated test has one response; leave it out"
            self.fault(f"element.{number}.across", alone if self.simulated else several)
        return next(iter(said), None)

    def printed(self, units: dict[str, str]) -> dict[str, sympy.Expr]:
        table = self.document.printed
        formulas: dict[str, sympy.Expr] = {}
        for key in ("stiffness", "damping"):
            text = getattr(table, key) if table else None
            if text is None:
                continue
            try:
                formulas[key] = parse(text, names={*units, "X", "X0", "omega"})
            except ExpressionError as fault:
                self.fault(f"printed.{key}", one_line(fault))
        return formulas

    def accept(self, elements: tuple[Element, ...], units: dict[str, str]) -> dict[str, float]:
        table = self.document.accept
        if table and self.document.model == "rank":
            self.fault(
                "accept", 'the law is not known before a ranking; leave [accept] out or model = "rank"'
            )
            return {}
        if table and not self.simulated:
            self.fault("accept", "a measured case has no truth to be compared with; leave [accept] out")
            return {}
        base = getattr(self.document.test, "base", None) is not None
        known = [*units, *([] if base else [MASS]), *force_keys(total_force(elements))]
        for name in table:
            if name not in known:
                hint = f"{suggest(name, known)}known: {', '.join(known)}"
                self.fault(f"accept.{_key(name)}", f"is no parameter; {hint}")
        return {name: value for name, value in table.items() if name in known}

    def truth_given(
        self, elements: tuple[Element, ...], units: dict[str, str], complete: bool
    ) -> dict[str, float]:
        """Return the true values of a simulated case; a measured one has none."""
        given = self.document.truth is not None
        if self.simulated and not given and any(e.parameters for e in elements):
            names = ", ".join(units)
            self.fault("truth", f"is missing; a simulated case needs a value for each of {names}")
        elif not self.simulated and given:
            self.fault("truth", "a measured case knows no truth; leave [truth] out")
        elif self.simulated and complete:
            return self.truth(elements, units)
        return {}

    def case(self, path: Path, text: str) -> Case:
        """Make the case of a document from its file and text.

        Raises
        ------
        CaseError
            With one sentence a fault, each with its key.
        """
        document = self.document
        self.texts()
        elements = self.elements()
        complete = len(elements) == len(self.tables) > 0
        units = self.parameters(elements)
        mass, mass_error, across = self.mass(), self.mass_error(), self.across()
        values = self.truth_given(elements, units, complete)
        printed = self.printed(units) if complete else {}
        accept = self.accept(elements, units) if complete else {}
        calibrated = document.identify is None or document.identify.calibrated
        test = (
            make_simulated(document.test, self.maker)
            if self.simulated
            else make_measured(document.test, self.maker, mass, calibrated, across)
        )
        # the motion that elements act across has no key of its own
        place = next((f"element.{n}.across:" for n, one in enumerate(self.tables, start=1) if one.across), "")
        self.faults[:] = [fault.replace("test.across:", place, 1) for fault in self.faults]
        observation = make_observation(document.identify, test, self.maker)
        if self.simulated and not calibrated:
            self.fault(
                "identify.calibrated",
                "is false; a simulated test has known units, so that true alone is allowed",
            )
        elif mass is not None and not calibrated:
            self.fault("system.mass", "a test that is not calibrated determines no mass; leave one out")
        fixed = self.fixed(elements, units)
        if self.faults:
            raise CaseError(self.faults)
        try:
            # where a test determines no mass, that of the case is known beforehand, as in a laboratory
            model = Model(elements, test.known_mass(mass), observation, fixed, mass_error)
        except RsgenError as fault:
            raise CaseError([f"identify.{one_line(fault)}"]) from None
        oscillator = Oscillator(cast("float", mass), elements, values) if self.simulated else None
        return Case(
            path=path,
            name=document.name,
            title=document.title,
            source=document.source,
            text=text,
            sha256=hashlib.sha256(text.encode("utf-8")).hexdigest(),
            oscillator=oscillator,
            model=model,
            test=test,
            truth=None if oscillator is None else {**oscillator.values, MASS: oscillator.mass},
            accept=accept,
            printed=printed,
            ranked=document.model == "rank",
        )


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
        _Builder(CaseDocument.model_validate(rest), folders).case(Path(), "")
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
    require(path, (str, os.PathLike), "path")
    file = Path(path)
    folders = _folders(file, data)
    try:
        text = read_text(file)
        tree = parse_case(text)
        try:
            case, faults = _Builder(CaseDocument.model_validate(tree), folders).case(file, text), list[str]()
        except ValidationError as error:
            case, faults = None, [*sentences(error, CaseDocument), *_further_faults(tree, error, folders)]
        except CaseError as error:
            case, faults = None, [*error.faults]
        said = {fault.partition(": ")[0] for fault in faults}
        faults += [fault for place, fault in open_places(tree).items() if place not in said]
        if case is None or faults:
            raise CaseError(faults)
        return case
    except CaseError as error:
        named = file.suffix.lower() == ".toml" or not file.is_file()
        other = "" if named else "; `rsgen init --from` writes the case of a data file"
        raise CaseError(f"{shown_path(file)}: {fault}{other}" for fault in error.faults) from error.__cause__


_TABLE = re.compile(r"\s*\[+([\w.]+)\]")
_OPEN_ENTRY = re.compile(r"\s*(\w+)\s*=.*# TODO: ")


def mark_open_entries(
    case: Case, test: ResponseSurface | MultisineSpectra
) -> ResponseSurface | MultisineSpectra:
    """Return the test of a case with its mass, and a doubt where an entry still has the TODO of its draft.

    No number of a test shows that a unit or a sign is another one, so that only a person can confirm these.
    """
    table, found = "", list[str]()
    for number, line in enumerate(case.text.split("\n"), start=1):
        if head := _TABLE.match(line):
            table = head[1]
        elif entry := _OPEN_ENTRY.match(line):
            found.append(f"{entry[1]} of {table} (line {number})")
    doubt = Finding("entries-not-confirmed", "doubt", names={"entries": listed(found)})
    weighed = {"mass": case.model.mass, "error": case.model.mass_error}
    numbers = {name: Quantity(value, "kg") for name, value in weighed.items() if value is not None}
    known = [Finding("mass-of-case", "info", "m", numbers)] if numbers else []
    # a file of an earlier run has the doubt and the mass of that time
    others = [one for one in test.findings if one.code not in (doubt.code, "mass-of-case")]
    return replace(test, findings=(*others, *([doubt] if found else []), *known))


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
            return rsgen.files.load_surface(source)
        if Path(source).suffix.lower() != ".toml":
            raise RsgenError(
                f"{shown_path(source)}: not a case (.toml) or a surface that rsgen saved (.h5); "
                "rsgen init --from DATA CASE.toml writes the case of a file"
            )
        source = load_case(source, data)
    test = source.test if isinstance(source, Case) else source
    if isinstance(test, MeasuredTest):
        # the readers of files are imported when the name is first used
        table = rsgen.files.read_measurement(test)
        return mark_open_entries(source, table) if isinstance(source, Case) else table
    raise RsgenError("the case is simulated and has no file to read; rsgen.simulate computes its surface")
