"""Compiled kernels on disk: found by content, published whole, compiled anew where a file is not as written.

Each kernel is a file, named by the hash of everything that it depends on, in a folder of this user alone.
Where no folder can be trusted, kernels are compiled in every process and stored nowhere.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

from rsgen.dynamics.kernel.machine_code import compile_source, host, load_object
from rsgen.dynamics.kernel.private_folder import UntrustedFolderError, open_private_folder

__all__ = ["cache_fault", "cache_folder", "is_stored", "load_kernel"]

_FORMAT = "3"  # of the files; raise it when their layout changes

_loaded: dict[str, Callable[..., Any]] = {}
_lock = Lock()


def cache_folder() -> Path:
    """Where compiled kernels are stored: ``RSGEN_CACHE`` where it is set, else the user's cache folder."""
    chosen = os.environ.get("RSGEN_CACHE")
    if chosen:
        return Path(chosen)
    import platformdirs

    return Path(platformdirs.user_cache_dir("rsgen", appauthor=False))


def cache_fault() -> str | None:
    """Why kernels are compiled in every process instead of stored; None where the cache can be trusted."""
    try:
        with open_private_folder(cache_folder()):
            return None
    except UntrustedFolderError as fault:
        return f"{cache_folder()}: {fault}"


@lru_cache(maxsize=256)
def _key(source: str) -> str:
    parts = (_FORMAT, source, version("numba"), version("llvmlite"), *host(), sys.implementation.cache_tag)
    return hashlib.sha256("\n".join(str(part) for part in parts).encode()).hexdigest()[:32]


def _stored(key: str) -> tuple[bytes, str] | None:
    """Object code and symbol of a kernel; None where the cache has none that can be trusted."""
    try:
        with open_private_folder(cache_folder()) as folder:
            content = folder.read(key)
    except UntrustedFolderError:
        return None
    if content is None:
        return None
    symbol, _, code = content.partition(b"\0")
    return code, symbol.decode()


def is_stored(source: str) -> bool:
    """Whether a kernel source was compiled before, so that loading it takes no time."""
    key = _key(source)
    return key in _loaded or _stored(key) is not None


def _compiled(key: str, source: str) -> tuple[bytes, str]:
    """Compile a kernel and store it where that can be done; the code is good even if storing fails."""
    code, symbol = compile_source(source, f"rsgen_kernel_{key}")
    with suppress(UntrustedFolderError, OSError), open_private_folder(cache_folder()) as folder:
        folder.write(key, symbol.encode() + b"\0" + code)
    return code, symbol


def load_kernel(source: str) -> Callable[..., Any]:
    """Load the compiled entry of a kernel source; compile it first where the cache has none."""
    key = _key(source)
    with _lock:
        if key not in _loaded:
            _loaded[key] = load_object(*(_stored(key) or _compiled(key, source)))
        return _loaded[key]
