"""The commands, their help and their options; what they do is imported when it is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["application"]


application = typer.Typer(
    name="rsgen",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="""Identify nonlinear springs and dampers from the response surface of a vibration test.

    A case file says what vibrates (laws of springs and dampers), how it is tested (simulated or measured)
    and what must come out. rsgen reads or simulates the response surface, identifies every parameter, and
    writes a report that is one HTML file.

    \b
    First steps:
      rsgen init gearbox                         write a commented case file
      rsgen check gearbox.toml                   find every fault in it, say what a run will do
      rsgen run gearbox.toml                     simulate, identify, compare, report
      rsgen run cases --out reports              the same for a folder of cases
      rsgen inspect sweep.mat                    what is in a measured file
      rsgen derive "k1*x + kn1*x**3 + c1*v"      equivalent stiffness and damping of any law
      rsgen rank cases/cubic.toml                find the law behind a test
      rsgen show reports/gearbox                 turn the response surface, read values
      rsgen diff before after                    what changed between two results

    \b
    Exit codes:
      0    every result is accepted or identified: a script may go on
      1    a result is missed (outside [accept]), doubtful or rejected: somebody has to look
      2    faulty input
      130  interrupted
    """,
)

Cases = Annotated[list[Path], typer.Argument(help="Case files, or folders of them.", show_default=False)]
OneCase = Annotated[Path, typer.Argument(help="A case file.", show_default=False)]
Out = Annotated[Path, typer.Option("--out", "-o", help="The folder of all results.")]
Data = Annotated[
    Path | None,
    typer.Option(
        help="Folder of measured files; otherwise RSGEN_DATA, then the case's own.", show_default=False
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Answer as JSON, for programs.")]
Plot = Annotated[
    Path | None,
    typer.Option(help="Draw the law, k(X) and c(X) into a .svg, .png or .pdf file.", show_default=False),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="A parameter (or omega) of the picture: name=value; others are 1.", show_default=False
    ),
]
Amplitude = Annotated[str | None, typer.Option(help="Largest amplitude, as '2 mm'.", show_default=False)]
Surface = Annotated[
    Path | None,
    typer.Option(help="A response surface that `rsgen simulate` wrote.", show_default=False),
]

Frf = Annotated[Path | None, typer.Option(help="Write receptances, universal (.uff).", show_default=False)]
Assume = Annotated[list[str] | None, typer.Option(help="That 'b>0'; repeatable.", show_default=False)]
Memory = Annotated[list[str] | None, typer.Option(help="A state: 'z = g(x, v, z)'.", show_default=False)]

Figures = Annotated[
    str | None,
    typer.Option(help="Save every figure beside the report, too: pdf, svg or png.", show_default=False),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        from rsgen import __version__
        from rsgen.app.cli.terminal import print_line

        print_line(f"rsgen {__version__}")
        raise typer.Exit


@application.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@application.command(short_help="From case files to reports.")
def run(
    cases: Cases,
    out: Out = Path("reports"),
    force: Annotated[bool, typer.Option("--force", "-f", help="Run even what is unchanged.")] = False,
    data: Data = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, max=256, help="Processes at a time.", show_default="processors"),
    ] = None,
    figures: Figures = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler whose workers see the same folders (needs rsgen[cluster]).",
            show_default=False,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Run cases from file to report; unchanged ones with a verified result are skipped.

    \b
    Examples:
      rsgen run cases
      rsgen run cases/cubic.toml --force
      rsgen run mine.toml --data /mnt/laboratory --out results
      rsgen run mine.toml --figures pdf
      rsgen run cases --cluster tcp://node1:8786
    """
    from rsgen.app.cli.run_command import run_command

    raise typer.Exit(run_command(cases, out, force, data, jobs, figures, json, cluster))


@application.command(short_help="Find every fault in case files.")
def check(cases: Cases, data: Data = None, json: Json = False) -> None:
    """Find every fault in case files, and say what a run will do.

    \b
    Examples:
      rsgen check cases
      rsgen check mine.toml --json
    """
    from rsgen.app.cli.check_command import check_command

    raise typer.Exit(check_command(cases, data, json))


@application.command(short_help="Describing functions of a force law.")
def derive(
    expression: Annotated[
        str,
        typer.Argument(help="A force law in x and v; every other name is a parameter.", show_default=False),
    ],
    memory: Memory = None,
    assume: Assume = None,
    plot: Plot = None,
    settings: Settings = None,
    amplitude: Amplitude = None,
    json: Json = False,
    latex: Annotated[bool, typer.Option("--latex", help="Write the formulas as LaTeX.")] = False,
) -> None:
    """Derive equivalent stiffness and damping of a force law, with the proof.

    \b
    Examples:
      rsgen derive "k*x + masing(Min(kt*x, Fs))" --json
      rsgen derive "k*x + z" --memory "z = alpha*v - bg*abs(v)*z - bd*v*abs(z)"
      rsgen derive "k*x + k3*x**3" --plot k.svg --set k=1000 --set "k3=20 N/mm^3" --amplitude "5 mm"
    """
    from rsgen.app.cli.derive_command import derive_command

    lists = memory or [], assume or []
    raise typer.Exit(derive_command(expression, *lists, plot, settings or [], amplitude, json, latex))


@application.command(short_help="From a case to a response surface.")
def simulate(
    case: OneCase,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The HDF5 file to write.", show_default="<name>.h5")
    ] = None,
    json: Json = False,
) -> None:
    """Simulate the test of a case and write the response surface as HDF5 (h5py, MATLAB, Julia read it).

    \b
    Example:
      rsgen simulate cases/cubic.toml --out cubic.h5
    """
    from rsgen.app.cli.identify_command import simulate_command

    raise typer.Exit(simulate_command(case, out, json))


@application.command(short_help="From a case to its parameters.")
def identify(
    case: OneCase, surface: Surface = None, data: Data = None, frf: Frf = None, json: Json = False
) -> None:
    """Identify the parameters of a case and print them; nothing is written but what --frf names.

    \b
    Examples:
      rsgen identify cases/cubic.toml
      rsgen identify cases/cubic.toml --surface cubic.h5 --json
      rsgen identify cases/cubic.toml --frf cubic.uff
    """
    from rsgen.app.cli.identify_command import identify_command

    raise typer.Exit(identify_command(case, surface, data, frf, json))


@application.command(short_help="Which law? The library ranked on a test.")
def rank(
    case: Annotated[
        Path, typer.Argument(help="A case file, or a response surface (.h5).", show_default=False)
    ],
    data: Data = None,
    json: Json = False,
) -> None:
    """Compare the laws of the library, alone and summed up to three, on the test of a case or on a surface.

    The verdict names the best law and those that fit equally well, or says that none fits and what is left
    unexplained. The law of the case is one more candidate.

    \b
    Examples:
      rsgen rank cases/cubic.toml
      rsgen rank cubic.h5 --json
    """
    from rsgen.app.cli.rank_command import rank_command

    raise typer.Exit(rank_command(case, data, json))


@application.command(short_help="Write reports anew, without simulating.")
def report(
    cases: Annotated[
        list[Path] | None, typer.Argument(help="Case files, or folders of them.", show_default=False)
    ] = None,
    out: Out = Path("reports"),
    data: Data = None,
    figures: Figures = None,
    json: Json = False,
) -> None:
    """Write reports anew from surfaces that earlier runs left; without a case, only index and table.

    \b
    Examples:
      rsgen report
      rsgen report cases/cubic.toml
      rsgen report cases/cubic.toml --figures pdf
    """
    from rsgen.app.cli.run_command import report_command

    raise typer.Exit(report_command(cases or [], out, data, figures, json))


@application.command(short_help="Write the lesson on a case alone.")
def notebook(
    case: OneCase,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The notebook.", show_default="<name>.ipynb")
    ] = None,
    data: Data = None,
    json: Json = False,
) -> None:
    """Write the executed notebook of a case: what, why, formula, code and figure, step by step.

    \b
    Examples:
      rsgen notebook cases/cubic.toml
      rsgen notebook cases/cubic.toml --out lesson.ipynb
    """
    from rsgen.app.cli.run_command import notebook_command

    raise typer.Exit(notebook_command(case, out, data, json))


@application.command(short_help="What changed between two results.")
def diff(
    before: Annotated[Path, typer.Argument(help="reports/<case>, or a folder of them.", show_default=False)],
    after: Annotated[Path, typer.Argument(help="The same, later.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Render a page, too.", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Say what changed between two results in values and verdicts; 1 if a verdict is graver than before.

    \b
    Examples:
      rsgen diff reports/cubic results/cubic
      rsgen diff reports results --out changes.html
    """
    from rsgen.app.cli.diff_command import diff_command

    raise typer.Exit(diff_command(before, after, out, json))


@application.command(short_help="Turn the response surface and read values.")
def show(
    folder: Annotated[Path, typer.Argument(help="reports/<case>.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The page.", show_default="<folder>-surface.html")
    ] = None,
    open_it: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    json: Json = False,
) -> None:
    """Write a page on which the response surface turns and shows its values (needs rsgen[show]).

    \b
    Examples:
      rsgen show reports/cubic --open
      rsgen show reports/cubic --out cubic-surface.html
    """
    from rsgen.app.cli.diff_command import show_command

    raise typer.Exit(show_command(folder, out, open_it, json))


@application.command(short_help="What is in a data file.")
def inspect(
    file: Annotated[Path, typer.Argument(help="A measured file of any format.", show_default=False)],
    everything: Annotated[bool, typer.Option("--all", help="List every array.")] = False,
    json: Json = False,
) -> None:
    """Show what is in a data file (text, MATLAB, universal, TDMS, Excel, ...), and propose a [test] table.

    \b
    Examples:
      rsgen inspect sweep.mat
      rsgen inspect receptances.uff --json
    """
    from rsgen.app.cli.inspect_command import inspect_command

    raise typer.Exit(inspect_command(file, everything, json))


@application.command(short_help="Begin a case file.")
def init(
    name: Annotated[
        str | None,
        typer.Argument(help="The case's name or file; asked for on a terminal.", show_default=False),
    ] = None,
    force: Annotated[
        str | None,
        typer.Option(
            "--law",
            help="The force law in x and v; terms in x become the spring.",
            show_default="k1*x + kn1*x**3 + c1*v",
        ),
    ] = None,
    memory: Memory = None,
    measured: Annotated[
        str | None, typer.Option(help="A data file: write a measured case.", show_default=False)
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option("--from", help="A data file: guess from it where what is.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The file.", show_default="<name>.toml")
    ] = None,
    json: Json = False,
) -> None:
    """Write a commented case file to begin with; without a name, answer three questions.

    \b
    Examples:
      rsgen init gearbox
      rsgen init joint --law "k*x + c*v + z" --memory "z = sigma*v*(1 - z*sign(v)/Fc)"
      rsgen init wire --measured wire.csv
      rsgen init --from sweep.mat wing.toml
    """
    from rsgen.app.cli.init_command import init_command

    raise typer.Exit(init_command(name, force, memory or [], measured, data, out, json))


@application.command(short_help="The library of force laws.")
def laws(
    name: Annotated[
        str | None, typer.Argument(help="One law of the library; without it, all.", show_default=False)
    ] = None,
    plot: Plot = None,
    settings: Settings = None,
    amplitude: Amplitude = None,
    json: Json = False,
) -> None:
    """List the library of force laws, or show one: formula, parameters, describing function, source.

    \b
    Examples:
      rsgen laws cubic-spring --plot cubic.svg --set k3=-0.5
    """
    from rsgen.app.cli.laws_command import laws_command

    raise typer.Exit(laws_command(name, plot, settings or [], amplitude, json))


# ----------------------------------------------------------------------------
# The command `rsgen modal`, beside the others.

Csv = Annotated[
    Path | None,
    typer.Option("--csv", help="Write all rows with their intervals, SI units.", show_default=False),
]


@application.command(short_help="Frequency and damping over amplitude, without a law.")
def modal(
    case: OneCase, surface: Surface = None, data: Data = None, csv: Csv = None, json: Json = False
) -> None:
    """Tabulate resonance frequency, damping ratio, stiffness and damping over the amplitude, without a law.

    Of the case the test, the mass and [identify] count; its law does not. Levels that are held out are
    predicted from the table and scored.

    \b
    Examples:
      rsgen modal cases/cubic.toml
      rsgen modal cases/cubic.toml --surface cubic.h5 --csv modal.csv
    """
    from rsgen.app.cli.rank_command import modal_command

    raise typer.Exit(modal_command(case, surface, data, csv, json))
