"""What the commands about results print: notebook, diff, show."""

from __future__ import annotations

from pathlib import Path

from rsgen.cli.terminal import number, print_json, print_line, print_table
from rsgen.errors import RsgenError
from rsgen.output import write_atomic

__all__ = ["diff_command", "notebook_command", "show_command"]

_WORDS: dict[object, str] = {True: "kept", False: "missed", None: "-"}


def _target(path: Path, ending: str, option: str = "--out") -> Path:
    if path.suffix.lower() != ending:
        raise RsgenError(f"{option} {path}: the name must end in {ending}")
    if not path.parent.is_dir():
        raise RsgenError(f"{option} {path}: there is no folder {path.parent}")
    return path


def notebook_command(path: Path, out: Path | None, data: Path | None, json: bool) -> int:
    """Write the executed notebook of a case; a measured one gets its surface beside it."""
    from rsgen.case import load_case
    from rsgen.cli.commands import read_surface
    from rsgen.report.interpretation import describe_mean
    from rsgen.report.notebook import write_notebook
    from rsgen.report.notebook_cells import KnownResults
    from rsgen.simulation import SimulatedTest
    from rsgen.surface import save_surface

    case = load_case(path, data)
    target = _target(out or Path(f"{case.name}.ipynb"), ".ipynb")
    surface = read_surface(case)
    results = KnownResults(case)
    results.add("simulate", case.oscillator, case.test, result=surface)
    beside = None
    if not isinstance(case.test, SimulatedTest):
        beside = target.with_suffix(".h5")
        save_surface(beside, surface)
        results.add("load_surface", beside.name, result=surface)
    write_notebook(
        target,
        case,
        results,
        mean=describe_mean(surface) is not None,
        held_out=bool(case.model.observation.hold_out),
        surface_file=beside.name if beside else "surface.h5",
    )
    if json:
        print_json({"case": case.name, "file": str(target), "surface": str(beside) if beside else None})
    else:
        print_line(f"{target}" + (f", which reads {beside}" if beside else ""))
    return 0


def diff_command(before: Path, after: Path, out: Path | None, json: bool) -> int:
    """Print what changed; the code is 1 if something accepted is no longer."""
    from rsgen.report.difference import compare_results, difference_data, render_difference

    target = None if out is None else _target(out, ".html")
    differences = compare_results(before, after)
    if target is not None:
        write_atomic(target, render_difference(differences, str(before), str(after)))
    if json:
        print_json(difference_data(differences))
        return int(any(difference.worse for difference in differences))
    rows = []
    for difference in differences:
        if difference.only:
            rows.append((difference.case, f"only {difference.only}", *[""] * 5))
        rows += [
            (
                difference.case,
                row.name,
                number(row.before, 8),
                number(row.after, 8),
                row.unit,
                "-" if row.change is None else f"{row.change:+.1e}",
                f"{_WORDS[row.passed_before]} -> {_WORDS[row.passed_after]}",
            )
            for row in difference.rows
            if row.changed and not difference.only
        ]
    if rows:
        print_table(("case", "value", "before", "after", "unit", "change", "verdict"), rows)
    changed = sum(difference.changed for difference in differences)
    worse = sum(difference.worse for difference in differences)
    cases = "case" if len(differences) == 1 else "cases"
    print_line(f"{changed} of {len(differences)} {cases} changed, {worse} for the worse")
    if target is not None:
        print_line(f"{target}")
    return int(worse > 0)


def show_command(folder: Path, out: Path | None, open_it: bool, json: bool) -> int:
    """Write the interactive page of a result; beside its folder, for what is inside is sealed."""
    from rsgen.report.interactive import render_interactive

    place = folder.resolve()
    target = _target(out or folder.with_name(f"{place.name}-surface.html"), ".html")
    write_atomic(target, render_interactive(folder))
    if json:
        print_json({"file": str(target)})
    else:
        print_line(f"{target}: open it in a browser")
    if open_it:
        import webbrowser

        webbrowser.open(target.resolve().as_uri())
    return 0
