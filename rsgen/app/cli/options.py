"""Arguments and options that several commands share, and what a file that they name for writing must be."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rsgen.common.errors import RsgenError
from rsgen.common.output import has_mark

if TYPE_CHECKING:
    from rsgen.cases import Case

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
    Path | None,
    typer.Option(help="A response surface that `rsgen simulate` wrote.", show_default=False),
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
FRF = b"receptances by level\nrsgen\n"
MODAL = b"amplitude [m],frequency [Hz],lower frequency [Hz]"
"""Text near the beginning of each kind of file that a command writes, and hardly of any other."""


def check_target(path: Path, ending: str, option: str) -> Path:
    """Refuse a name for a new file that has another ending or no folder."""
    if path.suffix.lower() != ending:
        raise RsgenError(f"{option} {path}: the name must end in {ending}")
    if not path.parent.is_dir():
        raise RsgenError(f"{option} {path}: there is no folder {path.parent}")
    return path


def inputs_of(case: Case, *others: Path | None) -> tuple[Path, ...]:
    """Return the files that a command on a case reads: the case, its data, and others that it was given."""
    data = case.test.all_files
    return (case.path, *data, *(path for path in others if path is not None))


def is_foreign(path: Path, mark: bytes) -> bool:
    """Return True if a path exists and lacks the mark of the file that a command would write."""
    return path.exists() and not has_mark(path, mark)


def refuse_foreign(path: Path, foreign: bool, reads: Iterable[Path], option: str = "--out") -> None:
    """Refuse, before anything is computed, to write over a file of the user.

    Parameters
    ----------
    foreign
        Whether what is there was not written by rsgen.
    reads
        Files that the command reads; they stay, whatever wrote them.

    Raises
    ------
    RsgenError
        It would; the file is as it was.
    """
    if not path.exists():
        return
    if any(other.exists() and path.samefile(other) for other in reads):
        raise RsgenError(f"{path}: is read by this command; choose another {option}")
    # an empty file, as mktemp makes one, holds nothing that could be lost
    if foreign and not (path.is_file() and path.stat().st_size == 0):
        raise RsgenError(
            f"{path}: is there and not as rsgen wrote it; move it away or choose another {option}"
        )
