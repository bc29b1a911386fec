"""A result's folder is built beside its place and moved there whole, so that a killed run harms nothing."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rsgen.errors import RsgenError
from rsgen.output import sync_folder
from rsgen.study.manifest import read_manifest

__all__ = ["recover", "replaced_folder"]

_DAY = 86_400.0


def _alive(process: int) -> bool:
    if os.name != "posix":
        # there, asking would end the process; age decides instead
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def recover(out: Path, name: str) -> None:
    """Clear up after killed runs of a case: a result moved aside comes back, unfinished ones are removed."""
    place = out / name
    for path in sorted(out.glob(f".{name}.*")):
        found = re.fullmatch(re.escape(f".{name}.") + r"(\d+)\.(part|old)", path.name)
        if not found or not path.is_dir():
            continue
        running = int(found[1]) != os.getpid() and _alive(int(found[1]))
        if running and time.time() - path.stat().st_mtime < _DAY:
            continue
        if found[2] == "old" and not place.exists() and read_manifest(path) is not None:
            path.rename(place)
        else:
            shutil.rmtree(path, ignore_errors=True)


@contextmanager
def replaced_folder(out: Path, name: str) -> Iterator[Path]:
    """Give an empty folder to fill; when the block ends without fault it takes the place ``out/name``.

    An earlier result stays untouched until then. Between the two renames a kill leaves the earlier result
    under its hidden name, from where ``recover`` brings it back.

    Parameters
    ----------
    out
        The folder of all results; made if missing.
    name
        The case's name, a plain one.

    Raises
    ------
    RsgenError
        The folder cannot be made or moved.
    """
    place = out / name
    part, old = (out / f".{name}.{os.getpid()}.{kind}" for kind in ("part", "old"))
    try:
        out.mkdir(parents=True, exist_ok=True)
        recover(out, name)
        if place.is_symlink() or (place.exists() and not place.is_dir()):
            raise RsgenError(f"{place}: is no folder; move it away, the result of the case goes there")
        part.mkdir()
    except OSError as fault:
        raise RsgenError(
            f"{place}: cannot be made: {fault.strerror or fault}; choose another --out"
        ) from fault
    try:
        yield part
        sync_folder(part)
        if place.exists():
            place.rename(old)
        part.rename(place)
        sync_folder(out)
    except OSError as fault:
        if old.exists() and not place.exists():
            old.rename(place)
        raise RsgenError(f"{place}: cannot be written: {fault.strerror or fault}") from fault
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if place.exists():
            shutil.rmtree(old, ignore_errors=True)
