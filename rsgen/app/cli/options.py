"""Arguments and options that several commands share, and what a file that they name for writing must be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rsgen.common.errors import RsgenError
from rsgen.common.output import has_mark

if TYPE_CHECKING:
    from rsgen.cases.case import Case

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
Surface = Annotated[
    Path | None, typer.Option(help="A response surface that `rsgen simulate` wrote.", show_default=False)
]
Memory = Annotated[list[str] | None, typer.Option(help="A state: 'z = g(x, v, z)'.", show_default=False)]
Figures = Annotated[
    str | None,
    typer.Option(help="Save every figure with the report, too: pdf, svg or png.", show_default=False),
]


# ----------------------------------------------------------------------------
# Files that a command writes: where they may lie, and that they never take the place of a user's file.

SPECTRA = b"omega0.npy"
"""Name of an array that a file of spectra has near its beginning."""
SURFACE = b"rsgen response surface"
MODAL = b"amplitude [m],frequency [Hz],lower frequency [Hz]"
"""Text near the beginning of each kind of file that a command writes, and hardly of any other."""


def checked_target(path: Path, ending: str, mark: bytes, option: str, case: Case, *read: Path | None) -> Path:
    """Refuse, before anything is computed, a place where a command cannot write, or a file of the user.

    Parameters
    ----------
    path, ending
        The file to write, and how its name must end.
    mark
        Of the kind of file that the command writes: another file is not written over.
    option
        The option that names it.
    case, read
        The case that the command reads, and further files; they and the data stay, whatever wrote them.

    Raises
    ------
    RsgenError
        The place is refused; a file there is as it was.
    """
    inputs = [case.path, *case.test.all_files, *filter(None, read)]
    if path.exists() and any(other.exists() and path.samefile(other) for other in inputs):
        raise RsgenError(f"{path}: is read by this command; choose another {option}")
    # an empty file, as mktemp makes one, holds nothing that could be lost
    empty = path.is_file() and path.stat().st_size == 0
    if path.exists() and not (empty or has_mark(path, mark)):
        raise RsgenError(
            f"{path}: is there and not as rsgen wrote it; move it away or choose another {option}"
        )
    if path.suffix.lower() != ending:
        raise RsgenError(f"{option} {path}: the name must end in {ending}")
    if not path.parent.is_dir():
        raise RsgenError(f"{option} {path}: there is no folder {path.parent}")
    return path
