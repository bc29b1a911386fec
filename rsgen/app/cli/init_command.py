"""The command `rsgen init`: a case file with a comment on every line that a beginner will change."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from os.path import commonpath
from pathlib import Path
from typing import Annotated

import sympy
import typer

from rsgen.app.cli.derive_command import read_memory
from rsgen.app.cli.inspect_command import proposal_text
from rsgen.app.cli.terminal import Json, Memory, print_json, print_line
from rsgen.cases.faults import name_fault, plain_name
from rsgen.cases.loading import DATA_VARIABLE
from rsgen.cases.tables import path_fault
from rsgen.common.errors import RsgenError, listed, quote, shown_path
from rsgen.common.output import write_atomic
from rsgen.files.inspection.clues import TODO
from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import propose
from rsgen.files.nominal_levels import level_form
from rsgen.formula.names import remembers, symbol
from rsgen.formula.printing import write
from rsgen.formula.unit_deduction import parameter_units
from rsgen.law.element import make_element
from rsgen.law.memory import equations_of
from rsgen.report.provenance import template_environment

_LAW = "k1*x + kn1*x**3 + c1*v"

# a spring that puts the resonance of 1.5 kg at 10 Hz, amid the frequencies above, lightly damped
_VALUES = {
    "N/m": "5.92 kN/m", "N/m^3": "2e5 N/m^3", "N/m^5": "1e8 N/m^5", "N*s/m": "3.8 N*s/m",
    "N*s^2/m^2": "1 N*s^2/m^2", "N": "0.5 N", "m": "20 mm",
}  # fmt: skip


def _value(unit: str) -> str:
    if unit in ("", "1"):
        return "1"
    return f'"{_VALUES.get(unit, f"1 {unit}")}"'


def _elements(law: str, memory: Mapping[str, str]) -> tuple[list[tuple[str, sympy.Expr]], dict[str, str]]:
    force = make_element("law", law, memory).force
    terms = sympy.Add.make_args(force)
    damper = [term for term in terms if term.has(symbol("v")) or remembers(term)]
    spring = [term for term in terms if term not in damper]
    parts = [("spring", spring), ("damper", damper)]
    units = dict(parameter_units(force))
    return [(name, sympy.Add(*part)) for name, part in parts if part], units


def case_text(name: str, law: str, test: str | None = None, memory: Mapping[str, str] | None = None) -> str:
    """Return the text of a case to begin with.

    Parameters
    ----------
    name
        The case's name.
    law
        A force law in x and v; terms with v or a memory go to the damper, the others to the spring.
    test
        The [test] tables of a measured case as TOML; None for a simulated one.
    memory
        g(x, v, z) of z' = g for every state z of the law.

    Raises
    ------
    RsgenError
        Name or law are not legal, or a law to be simulated has no damper.
    """
    fault = name_fault(name)
    if fault:
        raise RsgenError(f"name: {fault}")
    elements, units = _elements(law, memory or {})
    if test is None and all(element != "damper" for element, _ in elements):
        raise RsgenError("--law: has no term with v, so that no simulated motion settles; add a damper: c*v")
    names = sorted({free.name for _, part in elements for free in part.free_symbols} - {"x", "v"})
    width = max(map(len, names), default=0)
    # no HTML: name, law and path are checked
    template = template_environment(False).get_template("init/case.toml")
    return template.render(
        name=name,
        elements=[(element, write(part), equations_of(part)) for element, part in elements],
        truth=[(f"{name:<{width}}", _value(units.get(name, ""))) for name in names],
        tables=test,
    )


def _folder_of(files: list[Path], target: Path) -> Path:
    """Return the folder of the case, or where a file is not in it, the one that has all files."""
    parents = {file.parent for file in files}
    if all(parent.resolve().is_relative_to(target.parent.resolve()) for parent in parents):
        return target.parent
    return parents.pop() if len(parents) == 1 else Path(commonpath([one.resolve() for one in parents]))


def _drafted(files: list[Path], target: Path) -> str:
    """Return the [test] tables for data files, drafted from the first, as the case's folder sees them."""
    contents = [list_contents(file) for file in files]
    proposal = propose(contents[0])
    if proposal is None:
        raise RsgenError(
            f"{shown_path(files[0])}: no columns of numbers over one another are in it; see rsgen inspect"
        )
    folder = _folder_of(files, target)
    named = [(file.parent.resolve() / file.name).relative_to(folder.resolve()).as_posix() for file in files]
    for fault in filter(None, map(path_fault, named)):
        raise RsgenError(f"--from: {fault}")
    if folder != target.parent:
        proposal.doubts["test.file"] = f"in {folder}: set {DATA_VARIABLE} or --data to it"
    proposal.tables["test"]["file"] = named if len(named) > 1 else named[0]
    names, base = [file.name for file in files], proposal.tables.get("test.base", {})
    form = level_form(names, "[mu]?g") if base.get("quantity") == "acceleration" else level_form(names)
    level = proposal.tables.get("test.level", {})
    if form and not set(level) - {"value", "scale"}:
        level.pop("value", None)
        proposal.tables["test.level"] = {"name": form} | level
        proposal.doubts["test.level.name"] = "by the names of the files, of which * is any part"
    return proposal_text(proposal)


def _told_apart(words: list[str], data: list[Path]) -> tuple[str | None, list[Path]]:
    """Return the name of the case and the data files: of --from *.mat all but the first stand as words."""
    endings = ("", ".toml") if not data else (".toml",)
    files = [path for path in map(Path, words) if path.suffix not in endings and path.is_file()]
    # a wildcard in quotes, which no shell has replaced
    files = [one for path in (*data, *files) for one in (_matching(path) or [path])]
    names = [word for word in words if Path(word) not in files]
    if len(names) > 1:
        raise RsgenError(f"NAME: one case at a time, and no files: {listed(list(map(quote, names)))}")
    return (names[0] if names else None), files


def _matching(path: Path) -> list[Path]:
    """Return the files that a name with a wildcard stands for; none if it has none or is a file's own."""
    return sorted(path.parent.glob(path.name)) if "*" in path.name and not path.exists() else []


def init_command(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="The case's name or file; data files as well, as --from *.mat gives them.",
            show_default=False,
        ),
    ] = None,
    law: Annotated[
        str | None,
        typer.Option(
            "--law",
            help="The force law in x and v; terms in x become the spring.",
            show_default="k1*x + kn1*x**3 + c1*v",
        ),
    ] = None,
    memory: Memory = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--from",
            help="Draft the test by names and units of data files of one kind: --from *.mat.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The file.", show_default="<name>.toml")
    ] = None,
    force: Annotated[bool, typer.Option("--force", "-f", help="Replace a case that is there.")] = False,
    json: Json = False,
) -> int:
    """Write a commented case file to begin with.

    \b
    Examples:
      rsgen init gearbox
      rsgen init joint --law "k*x + c*v + z" --memory "z = sigma*v*(1 - z*sign(v)/Fc)"
      rsgen init --from sweep.mat wing.toml
      rsgen init --from run_*.csv wing.toml
    """
    name, data = _told_apart(words or [], data or [])
    if name is None and data:
        name = plain_name(data[0].stem) or None
    if name is None:
        raise RsgenError("NAME: is missing; rsgen init gearbox")
    file = Path(name)
    if file.suffix == ".toml":
        # a file was named: the case is called like it
        name, out = file.stem, out or file
    target = out or Path(f"{name}.toml")
    test = _drafted(data, target) if data else None
    text = case_text(name, law or _LAW, test, read_memory(memory or []))
    if target.exists() and not force:
        raise RsgenError(f"{target}: is there already; choose another name or --out, or --force")
    write_atomic(target, text)
    if json:
        print_json({"case": name, "file": str(target)})
        return 0
    asked = " each TODO and" if test and TODO in test else ""
    folder = _folder_of(data, target)
    where = f" --data {shlex.quote(str(folder))}" if folder != target.parent else ""
    print_line(f"{target}: change{asked} what you need, then `rsgen check {target}{where}`")
    if where:
        print_line(f"the data lie elsewhere: give --data to every command, or set {DATA_VARIABLE}")
    return 0
