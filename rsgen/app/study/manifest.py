"""The manifest: what a finished run wrote, from which inputs; without a valid one there is no result."""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import rsgen
from rsgen.common.output import write_atomic

__all__ = [
    "MANIFEST",
    "UNFINISHED",
    "file_hash",
    "inputs_unchanged",
    "listed_files",
    "program_hash",
    "read_manifest",
    "write_manifest",
]

MANIFEST = "manifest.json"
UNFINISHED = ".unfinished"
"""A file that says of a hidden folder that a run fills it; it goes before the folder takes its place."""
SCHEMA = 1
_PACKAGES = ("numpy", "scipy", "sympy", "numba", "matplotlib", "h5py", "pydantic", "pint")
_MAX_MANIFEST = 1_000_000
"""Bytes; a longer file is none of ours."""


def file_hash(path: Path) -> str:
    """Give the SHA-256 of a file in hexadecimal.

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
    """Give one SHA-256 over the program itself, so that results of older code are not taken for current."""
    package = Path(rsgen.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(package).as_posix().encode() + b"\0")
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


@cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "rsgen": rsgen.__version__}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def write_manifest(
    folder: Path, inputs: dict[str, str | None], seed: int | None, command: Iterable[str]
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
    """
    files = {
        path.relative_to(folder).as_posix(): file_hash(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in (MANIFEST, UNFINISHED)
    }
    content = {
        "schema": SCHEMA,
        "inputs": inputs,
        "program": program_hash(),
        "versions": _versions(),
        "platform": f"{platform.system()} {platform.machine()}, {sys.implementation.name}",
        "seed": seed,
        "command": list(command),
        "files": files,
    }
    write_atomic(folder / MANIFEST, json.dumps(content, indent=1, ensure_ascii=True) + "\n")


def _read(folder: Path) -> dict[str, Any] | None:
    """Read a manifest as it is written; None where there is none of this schema."""
    path = folder / MANIFEST
    try:
        if not path.is_file() or path.stat().st_size > _MAX_MANIFEST:
            return None
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        return None
    files = content.get("files")
    return content if isinstance(files, dict) and files else None


def listed_files(folder: Path) -> dict[str, str] | None:
    """Give the SHA-256 that each file of a result had when it was written; None without a manifest."""
    content = _read(folder)
    return None if content is None else content["files"]


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
    """Whether a manifest was written from the same inputs, by the same program and packages."""
    return (
        manifest.get("inputs") == inputs
        and manifest.get("program") == program_hash()
        and manifest.get("versions") == _versions()
    )
