"""A result's folder is built under a hidden name and then renamed, so that a killed run harms nothing."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import rsgen
from rsgen.common.errors import RsgenError, listed
from rsgen.common.output import has_mark, left_behind, read_small, sync_folder, write_atomic
from rsgen.report.provenance import package_versions

# Windows has no such locks
_locks: Any = import_module("fcntl") if os.name == "posix" else None

_INDEX, _INDEX_MARK = "index.html", b"<title>rsgen: all cases</title>"
"""The index of all results, and the marker near its beginning by which rsgen recognises its own."""

_LOCK_SECONDS = 10.0
"""Seconds for which a run waits until another one has begun, cleared up or moved: each takes far less."""

_POLL_SECONDS = 0.005
"""Interval between two attempts to take a lock."""


def recover(out: Path) -> None:
    """Clear up after killed runs: a hidden earlier result comes back, unfinished ones are removed.

    A hidden folder with such a name in which there is more than a run wrote stays.
    """
    if not out.is_dir():
        return
    with _alone(out):
        for path in sorted(out.iterdir()):
            name = left_behind(path)
            if name is None or path.is_symlink() or not path.is_dir() or _is_filled(path):
                continue
            place = out / name
            if path.suffix == ".old" and not place.exists() and read_manifest(path) is not None:
                path.rename(place)
            elif _of_a_run(path):
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Keep other runs from beginning, clearing up and moving in a folder of results.

    A folder without its mark, which is not yet there or no longer, would be taken for one left behind. Where
    there are no locks, or a lock does not end, the run goes on without.
    """
    with ExitStack() as opened:
        if _locks is not None:
            with suppress(OSError):
                handle = os.open(out, os.O_RDONLY)
                opened.callback(os.close, handle)
                _wait_for_lock(handle)
        yield


def _wait_for_lock(handle: int) -> None:
    end = time.monotonic() + _LOCK_SECONDS
    while time.monotonic() < end:
        with suppress(BlockingIOError):
            _locks.flock(handle, _locks.LOCK_EX | _locks.LOCK_NB)
            return
        time.sleep(_POLL_SECONDS)


@contextmanager
def _filling(part: Path) -> Iterator[None]:
    """Mark a folder as one that a run fills; a lock on the mark ends with the run, however that ends.

    The number of a process, in the folder's name, means another one in another container or machine that
    writes into the same folder of results, and the same one to another thread.
    """
    with (part / UNFINISHED).open("w") as mark:
        if _locks is not None:
            # some file systems have no locks; then the number alone decides
            with suppress(OSError):
                _locks.flock(mark, _locks.LOCK_EX | _locks.LOCK_NB)
            yield
            return
    yield


def _is_filled(hidden: Path) -> bool:
    """Return True if a run holds the lock on the mark of a hidden folder."""
    if _locks is None:
        return False
    try:
        # over a network only what is open for writing can be locked; a pipe would wait
        handle = os.open(hidden / UNFINISHED, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        _locks.flock(handle, _locks.LOCK_EX | _locks.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    finally:
        os.close(handle)
    return False


def _of_a_run(hidden: Path) -> bool:
    """Return True if a hidden folder holds only files of a run: a name alone is no proof."""
    if (hidden / UNFINISHED).is_file():
        return True
    try:
        check_replaceable(hidden)
    except (RsgenError, OSError):
        return False
    return True


def check_replaceable(place: Path) -> None:
    """Refuse to replace a folder that holds anything but what a run has written.

    Raises
    ------
    RsgenError
        It is a link, a file, a folder that no run made, or holds files that were added or changed since.
    """
    if place.is_symlink() or (place.exists() and not place.is_dir()):
        raise RsgenError(f"{place}: is no folder; move it away, the result of the case goes there")
    if not place.exists() or not any(place.iterdir()):
        return
    manifest = _read(place)
    if manifest is None:
        raise RsgenError(
            f"{place}: is a folder that no run made (it has no {MANIFEST}); move it away, or choose another "
            "--out"
        )
    strange = [
        path.relative_to(place).as_posix()
        for path in sorted(place.rglob("*"))
        if not _written_by_run(path, path.relative_to(place).as_posix(), manifest["files"])
    ]
    if strange:
        raise RsgenError(
            f"{place}: holds what no run wrote there: {listed(strange)}; move it "
            "away, for a new result replaces the whole folder"
        )


def check_index(out: Path) -> None:
    """Refuse a folder of results where an index was not written by rsgen.

    Raises
    ------
    RsgenError
        There is one; it is not touched.
    """
    place = out / _INDEX
    if place.is_symlink() or (place.exists() and not has_mark(place, _INDEX_MARK)):
        raise RsgenError(
            f"{place}: was not written by rsgen; move it away or choose another --out, for the index of "
            "all results has this name"
        )


def _written_by_run(path: Path, name: str, listed: Mapping[str, str]) -> bool:
    """Return True if a path below a result is as in its manifest: a file, or a folder on the way to one."""
    if path.is_symlink():
        return False
    if path.is_dir():
        return any(file.startswith(f"{name}/") for file in listed)
    return name == MANIFEST or (path.is_file() and name in listed and file_hash(path) == listed[name])


@contextmanager
def replaced_folder(out: Path, name: str) -> Iterator[Path]:
    """Return a folder to fill; when the block ends without fault it takes the place ``out/name``.

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
        The folder cannot be made or moved, or what is there is not a run's.
    """
    place = out / name
    part, old = (out / f".{name}.{os.getpid()}.{kind}" for kind in ("part", "old"))
    filling = ExitStack()
    try:
        out.mkdir(parents=True, exist_ok=True)
        recover(out)
        check_replaceable(place)
        with _alone(out):
            part.mkdir()
            filling.enter_context(_filling(part))
    except OSError as fault:
        raise RsgenError(
            f"{place}: cannot be made: {fault.strerror or fault}; choose another --out"
        ) from fault
    try:
        yield part
        # a file may have been put there meanwhile
        check_replaceable(place)
        with _alone(out):
            (part / UNFINISHED).unlink(missing_ok=True)
            sync_folder(part)
            if place.exists():
                place.rename(old)
            part.rename(place)
            sync_folder(out)
    except OSError as fault:
        if old.exists() and not place.exists():
            with suppress(OSError):
                old.rename(place)
        raise RsgenError(f"{place}: cannot be written: {fault.strerror or fault}") from fault
    finally:
        filling.close()
        shutil.rmtree(part, ignore_errors=True)
        if place.exists() and _of_a_run(old):
            shutil.rmtree(old, ignore_errors=True)


# ----------------------------------------------------------------------------
# The manifest: what a finished run wrote, from which inputs; without a valid one there is no result.

MANIFEST = "manifest.json"
UNFINISHED = ".unfinished"
"""A file that says of a hidden folder that a run fills it; it goes before the folder takes its place."""
SCHEMA = 1


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal.

    Raises
    ------
    OSError
        It cannot be read, or is no plain file: a pipe would never end.
    """
    if not path.is_file():
        raise FileNotFoundError(path)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def program_hash() -> str:
    """Return one SHA-256 over the program itself, so that results of older code are not taken for current."""
    package = Path(rsgen.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(package).as_posix().encode() + b"\0")
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


def write_manifest(
    folder: Path,
    inputs: dict[str, str | None],
    seed: int | None,
    command: Iterable[str],
    case_file: Path | None = None,
) -> None:
    """Write the manifest of a folder whose other files are complete.

    Parameters
    ----------
    folder
        Every file in it is listed with its SHA-256.
    inputs
        SHA-256 of what the run read, by what it is.
    seed
        Of the noise, where there was one.
    command
        What was called.
    case_file
        The case; it is listed relative to the folder of all results, so that both can be moved together.
    """
    files = {
        path.relative_to(folder).as_posix(): file_hash(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in (MANIFEST, UNFINISHED)
    }
    content = {
        "schema": SCHEMA,
        "inputs": inputs,
        "case_file": None if case_file is None else _relative(case_file, folder.parent),
        "program": program_hash(),
        "versions": package_versions(),
        "platform": f"{platform.system()} {platform.machine()}, {sys.implementation.name}",
        "seed": seed,
        "command": list(command),
        "files": files,
    }
    write_atomic(folder / MANIFEST, json.dumps(content, indent=1, ensure_ascii=True) + "\n")


def _relative(path: Path, folder: Path) -> str | None:
    """Return a path relative to a folder; None on another drive."""
    with suppress(ValueError):
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    return None


def case_file_of(folder: Path) -> Path | None:
    """Return the case file that a result is from; None where it is not known or has gone."""
    content = _read(folder)
    name = None if content is None else content.get("case_file")
    path = (folder.parent / name).resolve() if isinstance(name, str) else None
    return path if path is not None and path.is_file() else None


def _read(folder: Path) -> dict[str, Any] | None:
    """Read a manifest as it is written; None where there is none of this schema."""
    path = folder / MANIFEST
    try:
        content = json.loads(read_small(path))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        return None
    files = content.get("files")
    return content if isinstance(files, dict) and files else None


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Read a manifest and check every file that it lists; None where anything is missing or changed."""
    content = _read(folder)
    if content is None:
        return None
    try:
        for name, digest in content["files"].items():
            # a manifest may not vouch for files elsewhere
            if ".." in Path(name).parts or Path(name).is_absolute() or file_hash(folder / name) != digest:
                return None
    except (OSError, ValueError):
        return None
    return content


def inputs_unchanged(manifest: dict[str, Any], inputs: dict[str, str | None]) -> bool:
    """Return True if a manifest was written from the same inputs, by the same program and packages."""
    return (
        manifest.get("inputs") == inputs
        and manifest.get("program") == program_hash()
        and manifest.get("versions") == package_versions()
    )
