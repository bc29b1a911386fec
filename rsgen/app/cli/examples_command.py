"""The command `rsgen examples`: the cases and data that README and the pages use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rsgen
from rsgen.app.cli.terminal import Json, print_json, print_line
from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic


def _examples() -> Path:
    """Return the folder of the examples: within an installed package, next to that of a checkout."""
    package = Path(rsgen.__file__).parent
    packed = package / "examples"
    return packed if packed.is_dir() else package.parent / "cases"


def examples_command(
    folder: Annotated[
        Path, typer.Argument(help="The examples go to cases/ in this folder.", show_default=False)
    ],
    json: Json = False,
) -> int:
    """Write the cases and data files that README and the pages of the documentation use.

    Every command of the documentation works in FOLDER afterwards. A file that differs is never replaced.

    \b
    Example:
      rsgen examples .
    """
    source, place = _examples(), folder / "cases"
    files = [path for path in sorted(source.rglob("*")) if path.is_file() and path.suffix != ".pyc"]
    contents = {place / path.relative_to(source): path.read_bytes() for path in files}
    try:
        for target, content in contents.items():
            if target.exists() and not (target.is_file() and target.read_bytes() == content):
                raise RsgenError(
                    f"{target}: is there and differs from the example; nothing was written; "
                    "move it away or choose another folder"
                )
        for target, content in contents.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            if not target.exists():
                write_atomic(target, content)
    except OSError as fault:
        raise RsgenError(f"{fault.filename}: {fault.strerror}") from fault
    if json:
        print_json({"files": [str(target) for target in contents]})
        return 0
    print_line(f"{place}: {len(contents)} example files; try `rsgen run {place / 'cubic.toml'}`")
    return 0
