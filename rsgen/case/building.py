"""From the checked document to the objects of rsgen; faults that concern several keys are found here."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import sympy

from rsgen.case.document import CaseDocument, ElementTable, MeasuredTable, SimulatedTable
from rsgen.case.grid import expand, size_fault
from rsgen.case.measured import build_measured
from rsgen.case.naming import name_fault, quote, suggest, text_fault
from rsgen.errors import ExpressionError, RsgenError
from rsgen.expression import check_name, parse, symbol, write
from rsgen.law.element import Element, make_element
from rsgen.law.library import laws
from rsgen.measurement import MeasuredTest
from rsgen.observation import Observation
from rsgen.oscillator import Model, Oscillator
from rsgen.simulation import SimulatedTest
from rsgen.units import parameter_units, quantity, unit_faults, unit_of

__all__ = ["Parts", "build"]

MASS = "m"
FORCES = ("stiffness_force", "damping_force")
_STATES = ("x", "v", "X", "X0", "omega")


def _make(table: ElementTable) -> Element:
    """Make a spring or damper from its formula, or from a law of the library."""
    if table.law is not None:
        return laws[table.law].element(table.name, table.parameters)
    if table.force is None:
        raise RsgenError("is missing; a formula in x and v, or 'law' with the name of a law (rsgen laws)")
    if table.parameters:
        raise RsgenError("'parameters' renames those of a 'law'; a formula names its own")
    return make_element(table.name, table.force)


@dataclass(slots=True)
class Parts:
    """What a case consists of besides its texts; filled as far as the faults allow."""

    oscillator: Oscillator | None = None
    model: Model | None = None
    test: SimulatedTest | MeasuredTest | None = None
    truth: Mapping[str, float] | None = None
    accept: Mapping[str, float] = field(default_factory=dict)
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def _reason(fault: Exception) -> str:
    return " ".join(str(fault).split())


class _Builder:
    """Collects faults while the parts are built one after the other."""

    def __init__(self, document: CaseDocument, folders: tuple[Path, ...]) -> None:
        self.document = document
        self.folders = folders
        self.parts = Parts()
        self.faults = self.parts.faults
        self.units_fit = True

    def quantity(self, path: str, value: float | str, unit: str) -> float | None:
        """Turn a value into SI, or note a fault."""
        try:
            return quantity(value, unit)
        except RsgenError as fault:
            self.faults.append(f"{path}: {_reason(fault)}")
            return None

    def texts(self) -> None:
        document = self.document
        fault = name_fault(document.name)
        if fault:
            self.faults.append(f"name: {fault}")
        for key in ("title", "source"):
            text = getattr(document, key)
            fault = text_fault(text) if text or key == "title" else None
            if fault:
                self.faults.append(f"{key}: {fault}")

    @property
    def tables(self) -> list[ElementTable]:
        """The elements of the file; of a ranking without any, spring and damper that all candidates have."""
        document = self.document
        if document.element is not None:
            return document.element
        if document.model == "rank" and isinstance(document.test, MeasuredTable):
            return [ElementTable(name=name, law=name) for name in ("linear-spring", "linear-damper")]
        return []

    def elements(self) -> tuple[Element, ...]:
        if not self.tables:
            self.faults.append(
                'element: is missing; every case needs it, but a measured one with model = "rank"'
            )
        built = []
        taken: set[str] = set()
        for number, table in enumerate(self.tables, start=1):
            fault = name_fault(table.name)
            if fault:
                self.faults.append(f"element.{number}.name: {fault}")
            elif table.name.casefold() in taken:
                self.faults.append(
                    f"element.{number}.name: {quote(table.name)} is used twice; names must be unique"
                )
            taken.add(table.name.casefold())
            key = "force" if table.law is None else "law"
            if table.law is not None and table.force is not None:
                self.faults.append(f"element.{number}: has 'force' and 'law'; one of them says the law")
                continue
            try:
                element = _make(table)
            except RsgenError as error:
                self.faults.append(f"element.{number}.{key}: {_reason(error)}")
                continue
            if MASS in element.parameters:
                self.faults.append(f"element.{number}.{key}: 'm' is the mass; name the parameter otherwise")
            built.append(element)
        return tuple(built)

    def parameters(self, elements: tuple[Element, ...]) -> dict[str, str]:
        """Give the unit of every parameter, and note where its dimension contradicts itself."""
        force = sympy.Add(*(element.force for element in elements))
        try:
            units = dict(parameter_units(force))
        except RsgenError as fault:
            self.faults.append(f"element: {_reason(fault)}")
            self.units_fit = False
            units = {}
        names = sorted({name for element in elements for name in element.parameters})
        for name in names:
            twins = [other for other in names if other != name and other.casefold() == name.casefold()]
            if twins and name < min(twins):
                self.parts.warnings.append(f"parameters {name} and {', '.join(twins)} differ by case only")
        return {name: units.get(name, "") for name in names}

    def truth(self, elements: tuple[Element, ...], units: dict[str, str]) -> dict[str, float]:
        """Turn every true value into SI; its unit must make every term of the law a force."""
        before = len(self.faults)
        table = self.document.truth or {}
        force = sympy.Add(*(element.force for element in elements))
        values: dict[str, float] = {}
        for name, value in table.items():
            if name not in units:
                self.faults.append(f"truth.{self._key(name)}: {self._unknown(name, units)}")
                continue
            try:
                values[name] = quantity(value, units[name] or None)
            except RsgenError as fault:
                term = next((part for part in sympy.Add.make_args(force) if part.has(symbol(name))), force)
                why = f"; {write(term)} must be a force" if units[name] and "needed" in str(fault) else ""
                self.faults.append(f"truth.{name}: {_reason(fault)}{why}")
        for number, element in enumerate(elements, start=1):
            for name in element.parameters:
                if name not in table and name != MASS:
                    known = f"known: {', '.join(sorted(k for k in table if k in units)) or 'none'}"
                    self.faults.append(
                        f"element.{number}.force: {quote(name)} has no value in [truth]; {known}"
                    )
        if len(self.faults) == before and self.units_fit:
            # where the law alone does not tell the units, those of the values must at least fit together
            given = {name: unit_of(value) for name, value in table.items()}
            contradictions = unit_faults(force, {name: unit for name, unit in given.items() if unit})
            self.faults += [f"truth: {sentence}" for sentence in contradictions]
        return values

    @staticmethod
    def _key(name: str) -> str:
        return name if name.isidentifier() and len(name) <= 40 else quote(name)

    @staticmethod
    def _unknown(name: str, known: Collection[str]) -> str:
        listed = f"known: {', '.join(known) or 'none'}"
        if name == MASS:
            return f"is the mass; it stands in [system]; {listed}"
        try:
            check_name(name)
        except ExpressionError as fault:
            return _reason(fault)
        return f"is no parameter of the elements; {suggest(name, known)}{listed}"

    def mass(self, simulated: bool) -> float | None:
        value = self.document.system.mass
        if value is None:
            if simulated:
                self.faults.append('system.mass: is missing; a simulated case needs a mass such as "1.5 kg"')
            return None
        mass = self.quantity("system.mass", value, "kg")
        if mass is not None and mass <= 0:
            self.faults.append(f"system.mass: is {mass:g} kg; must be above 0")
            return None
        return mass

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
                self.faults.append(f"printed.{key}: {_reason(fault)}")
        return formulas

    def simulated(self, table: SimulatedTable) -> SimulatedTest | None:
        before = len(self.faults)
        unit = "N" if table.control == "force" else "m"
        level = expand(table.level, "test.level", lambda p, v: self.quantity(p, v, unit), self.faults)
        frequency = expand(
            table.frequency, "test.frequency", lambda p, v: self.quantity(p, v, "Hz"), self.faults
        )
        counts = tuple(
            g.count if row is None else None
            for g, row in ((table.level, level), (table.frequency, frequency))
        )
        fault = size_fault(level, frequency, counts=counts)
        if fault:
            self.faults.append(f"test: {fault}")
        if len(self.faults) > before or level is None or frequency is None:
            return None
        noise = table.noise
        try:
            return SimulatedTest(
                level=level,
                frequency=frequency,
                sweep=table.sweep,
                harmonics=table.harmonics,
                accuracy=table.accuracy,
                noise_relative=noise.relative if noise else 0.0,
                seed=noise.seed if noise else 1,
                method=table.method,
                control=table.control,
            )
        except RsgenError as error:
            self.faults.append(_reason(error))
            return None

    def hold_out(self, test: SimulatedTest | MeasuredTest | None) -> tuple[float, ...]:
        unit = "m" if isinstance(test, SimulatedTest) and test.control == "response" else "N"
        levels = []
        for number, value in enumerate(self.document.identify.hold_out, start=1):
            path = f"identify.hold_out.{number}"
            level = self.quantity(path, value, unit)
            if level is None:
                continue
            if isinstance(test, SimulatedTest):
                near = test.level[abs(test.level - level) <= 1e-9 * abs(level)]
                if not len(near):
                    self.faults.append(f"{path}: {level:g} {unit} is not tested; one of test.level needed")
                    continue
                level = float(near[0])
            if level in levels:
                self.faults.append(f"{path}: {level:g} {unit} stands twice; each level once")
                continue
            levels.append(level)
        if isinstance(test, SimulatedTest) and levels and len(levels) == len(test.level):
            self.faults.append("identify.hold_out: holds every level back; at least one must remain")
        return tuple(levels)

    def band(self) -> tuple[float, float] | None:
        given = self.document.identify.band
        if given is None:
            return None
        ends = [self.quantity(f"identify.band.{i}", end, "Hz") for i, end in enumerate(given, start=1)]
        if None in ends:
            return None
        low, high = (float(end or 0.0) for end in ends)
        if not 0 <= low < high:
            self.faults.append(f"identify.band: {low:g} to {high:g} Hz; the lower end first, 0 Hz or more")
            return None
        return low, high

    def accept(self, units: dict[str, str], simulated: bool) -> dict[str, float]:
        table = self.document.accept
        if table and self.document.model == "rank":
            self.faults.append(
                'accept: the law is not known before a ranking; leave [accept] out or model = "rank"'
            )
            return {}
        if table and not simulated:
            self.faults.append("accept: a measured case has no truth to be compared with; leave [accept] out")
            return {}
        known = [*units, MASS, *FORCES]
        for name in table:
            if name not in known:
                hint = f"{suggest(name, known)}known: {', '.join(known)}"
                self.faults.append(f"accept.{self._key(name)}: is no parameter; {hint}")
        return {name: value for name, value in table.items() if name in known}

    def build(self) -> Parts:
        document, parts = self.document, self.parts
        table = document.test
        simulated = isinstance(table, SimulatedTable)
        self.texts()
        elements = self.elements()
        complete = len(elements) == len(self.tables) > 0
        units = self.parameters(elements)
        mass = self.mass(simulated)
        values: dict[str, float] = {}
        if simulated and document.truth is None and any(e.parameters for e in elements):
            names = ", ".join(units)
            self.faults.append(f"truth: is missing; a simulated case needs a value for each of {names}")
        elif not simulated and document.truth is not None:
            self.faults.append("truth: a measured case knows no truth; leave [truth] out")
        elif simulated and complete:
            values = self.truth(elements, units)
        if complete:
            parts.printed = MappingProxyType(self.printed(units))
            parts.accept = MappingProxyType(self.accept(units, simulated))
        if isinstance(table, MeasuredTable):
            scaled = document.identify.calibrated
            parts.test = build_measured(table, self.folders, self.faults, mass, scaled)
        else:
            parts.test = self.simulated(table)
        hold_out = self.hold_out(parts.test)
        band = self.band()
        if mass is not None and not document.identify.calibrated:
            self.faults.append("system.mass: a test that is not calibrated tells no mass; leave one out")
        if self.faults:
            return parts
        # "1" is how units calls a plain number; downstream that is no unit
        parts.units = MappingProxyType({**{k: "" if u == "1" else u for k, u in units.items()}, MASS: "kg"})
        given = document.identify
        observation = Observation(given.background, hold_out, band, given.calibrated)
        parts.model = Model(elements, None if simulated else mass, observation)
        if simulated and mass is not None:
            parts.oscillator = Oscillator(mass, elements, values)
            parts.truth = MappingProxyType({**values, MASS: mass})
        return parts


def build(document: CaseDocument, folders: tuple[Path, ...]) -> Parts:
    """Build oscillator, model, test, truth and the rest; ``parts.faults`` tells what stands against it.

    Parameters
    ----------
    document
        The case file, its shapes checked.
    folders
        Where a measured file is looked for, in this order.
    """
    return _Builder(document, folders).build()
