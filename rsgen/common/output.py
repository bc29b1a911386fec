"""Files of a run: written whole or not at all, recognised by a mark, read back only where they are small."""

from __future__ import annotations

import os
import re
import stat
import tempfile
import time
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

from rsgen.common.errors import RsgenError

_MAX_AGE = timedelta(days=1).total_seconds()
"""Seconds after which an unfinished file or folder is left behind, even if its number is a process again."""

_UNFINISHED = re.compile(r"\.(?P<name>.+)\.(?P<process>\d+)(\.\w+)?\.(part|old)")
"""Name of an unfinished file or folder: whose place it takes, and who writes it."""

MAX_NAME = 64
"""Characters of the name of a case, or of a file in that of its unfinished one: systems refuse others."""


MAX_BYTES = 50_000_000
"""Of a file of a run that is read back; those that runs write are smaller."""

_MARKED_BYTES = 4096
"""Bytes at the beginning of a file in which its mark stands."""


def read_small(path: Path, most: int = MAX_BYTES) -> bytes:
    """Read a plain file of at most so many bytes: a pipe would never end, nor would a device.

    Raises
    ------
    OSError
        It cannot be read, is no plain file, or is larger.
    """
    if not path.is_file() or path.stat().st_size > most:
        raise FileNotFoundError(path)
    return path.read_bytes()


def has_mark(path: Path, mark: bytes) -> bool:
    """Return True for a plain file with the mark near its beginning."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return mark in file.read(_MARKED_BYTES)


def _permissions() -> int:
    # the mode a plain open() would give; mkstemp's 0600 would hide reports from a web server or a group
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def is_alive(process: int) -> bool:
    """Return True if a process of this machine has this number, as far as the system says."""
    if os.name != "posix":
        # there, asking would end the process; age decides instead
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def left_behind(path: Path) -> str | None:
    """Return the final name of an unfinished file or folder; None unless its writer is gone."""
    found = _UNFINISHED.fullmatch(path.name)
    if found is None:
        return None
    with suppress(OSError):
        process, age = int(found["process"]), time.time() - path.lstat().st_mtime
        if process != os.getpid() and is_alive(process) and age < _MAX_AGE:
            return None
    return found["name"]


def sync_folder(folder: Path) -> None:
    """Make a rename inside a folder durable; Windows cannot open folders and needs no such step."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _clear(target: Path) -> None:
    """Remove what killed writers of this file left."""
    for path in target.parent.iterdir():
        if path.is_file() and path.suffix == ".part" and left_behind(path) == target.name[:MAX_NAME]:
            path.unlink(missing_ok=True)


def write_atomic(path: str | os.PathLike[str], data: str | bytes) -> None:
    """Write a file so that a reader, or a crash, finds the old file or the new one, never a part.

    The data go to a temporary file in the same folder, are flushed to the disk and renamed onto ``path``.
    A symbolic link at ``path`` is replaced, never followed.

    Parameters
    ----------
    path
        The file to write; its folder must exist.
    data
        The whole content; text is written as UTF-8 with line ends as they are.

    Raises
    ------
    RsgenError
        The folder is missing, ``path`` is a folder, the disk is full, or writing is not permitted; what was
        at ``path`` before is still there.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_atomic(pathlib.Path(folder) / "note.txt", "k1 = 5920 N/m")
    ...     pathlib.Path(folder, "note.txt").read_text()
    'k1 = 5920 N/m'
    """
    target = Path(path)
    content = data.encode("utf-8") if isinstance(data, str) else data
    temporary: Path | None = None
    try:
        if target.exists() and not target.is_symlink() and not stat.S_ISREG(target.stat().st_mode):
            raise RsgenError(f"{target}: is no regular file; only files are written")
        _clear(target)
        prefix = f".{target.name[:MAX_NAME]}.{os.getpid()}."
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=prefix, suffix=".part")
        temporary = Path(name)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(_permissions())
        temporary.replace(target)
        temporary = None
        sync_folder(target.parent)
    except OSError as fault:
        raise RsgenError(f"{target}: cannot be written: {fault.strerror or fault}") from fault
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
