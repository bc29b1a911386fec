"""Paths to data files in a case: relative, plain, and inside the allowed folders."""

from __future__ import annotations

from pathlib import Path

from rsgen.cases.naming import is_device
from rsgen.common.errors import quote

__all__ = ["path_fault", "resolve_files"]

MAX_PATH = 400
MAX_PART = 120


def path_fault(text: str) -> str | None:
    """Say why a text is no path to a data file inside the allowed folders, or None where it is one.

    Examples
    --------
    >>> path_fault("wire/example6.txt") is None
    True
    >>> path_fault("../secret.csv")
    "'../secret.csv' leaves its folder; a relative path with / and without .. is allowed"
    """
    allowed = "a relative path with / and without .. is allowed"
    if not text or len(text) > MAX_PATH:
        return f"has {len(text)} characters; 1 to {MAX_PATH} are allowed"
    if not text.isprintable() or any(sign in text for sign in '\\:*?"<>|$~'):
        return f"{quote(text)} contains a sign that no data file may have; {allowed}"
    parts = text.split("/")
    if text.startswith("/"):
        return f"{quote(text)} is an absolute path; {allowed}"
    if ".." in parts:
        return f"{quote(text)} leaves its folder; {allowed}"
    if any(not part or part == "." or part != part.strip() or part.startswith("-") for part in parts):
        return f"{quote(text)} has a part that is empty, '.', begins with - or ends in a blank; {allowed}"
    if any(len(part) > MAX_PART or part.endswith(".") or is_device(part) for part in parts):
        return f"{quote(text)} is no file name on every system; {allowed}"
    return None


def _resolve(text: str, folders: tuple[Path, ...], key: str, faults: list[str]) -> Path:
    for folder in folders:
        path = folder / text
        try:
            there = path.exists()
        except OSError as fault:
            faults.append(f"{key}: cannot be looked for: {fault.strerror}; a file that may be read is needed")
            return path
        if there:
            if not path.resolve().is_relative_to(folder.resolve()):
                faults.append(f"{key}: {quote(text)} leads out of its folder; a file inside it is needed")
            return path
    # nowhere: the case's own folder is the last, and the place to name
    return folders[-1] / text


def resolve_files(
    texts: list[str], folders: tuple[Path, ...], key: str, faults: list[str]
) -> tuple[Path, ...]:
    """Find data files; what is wrong with a path is appended to ``faults``, after its key.

    Parameters
    ----------
    texts
        Relative paths, as a case has them.
    folders
        Where they are looked for, in this order; the last is meant when they are nowhere.
    """
    paths = []
    for number, text in enumerate(texts, start=1):
        place = key if len(texts) == 1 else f"{key}.{number}"
        fault = path_fault(text)
        if fault:
            faults.append(f"{place}: {fault}")
        paths.append(folders[-1] if fault else _resolve(text, folders, place, faults))
    return tuple(paths)
