"""Compiled kernels on disk: found by content, published whole, rebuilt when damaged.

Each kernel has a folder, named by the hash of everything that it depends on. It is compiled in a
temporary folder that is then renamed, so that parallel processes never see half a kernel; a list of checksums
inside shows damage before machine code is loaded.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

from rsgen.errors import RsgenError
from rsgen.kernel.machine_code import compile_source, host, load_object

__all__ = ["cache_folder", "load_kernel"]

_SOURCE, _OBJECT, _LIST = "kernel.py", "kernel.o", "kernel.json"
_FORMAT = "2"  # of the folder; raise it when its layout changes

_loaded: dict[str, Callable[..., Any]] = {}
_lock = Lock()


def cache_folder() -> Path:
    """Where compiled kernels are stored: ``RSGEN_CACHE`` where it is set, else the user's cache folder."""
    chosen = os.environ.get("RSGEN_CACHE")
    if chosen:
        return Path(chosen)
    import platformdirs

    return Path(platformdirs.user_cache_dir("rsgen", appauthor=False))


def _key(source: str) -> str:
    parts = (_FORMAT, source, version("numba"), version("llvmlite"), *host(), sys.implementation.cache_tag)
    return hashlib.sha256("\n".join(str(part) for part in parts).encode()).hexdigest()[:32]


def _read(folder: Path, source: str) -> tuple[bytes, str] | None:
    """Object code and symbol of a folder where all is as it was written, else None."""
    try:
        entry = json.loads((folder / _LIST).read_text(encoding="utf-8"))
        code = (folder / _OBJECT).read_bytes()
        healthy = (
            isinstance(entry, dict)
            and entry.get("sha256") == hashlib.sha256(code).hexdigest()
            and isinstance(entry.get("symbol"), str)
            and (folder / _SOURCE).read_text(encoding="utf-8") == source
        )
        return (code, entry["symbol"]) if healthy else None
    except (OSError, ValueError):
        return None


def _build(home: Path, target: Path, source: str) -> tuple[bytes, str]:
    """Compile in a temporary folder and publish it; the code is good even if publishing fails."""
    folder = Path(tempfile.mkdtemp(dir=home, prefix=".building-"))
    try:
        (folder / _SOURCE).write_text(source, encoding="utf-8")
        code, symbol = compile_source(folder / _SOURCE, f"rsgen_kernel_{target.name}")
        (folder / _OBJECT).write_bytes(code)
        entry = {"symbol": symbol, "sha256": hashlib.sha256(code).hexdigest()}
        (folder / _LIST).write_text(json.dumps(entry), encoding="utf-8")
        if target.exists():
            shutil.rmtree(target, ignore_errors=True)
        try:
            folder.rename(target)
        except OSError:
            # another process was first; its kernel is as good
            shutil.rmtree(folder, ignore_errors=True)
        return code, symbol
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def load_kernel(source: str) -> Callable[..., Any]:
    """Load the compiled entry of a kernel source; compile it first where the cache has none.

    Raises
    ------
    RsgenError
        The cache folder cannot be written and no other place is left.
    """
    key = _key(source)
    with _lock:
        if key not in _loaded:
            _loaded[key] = load_object(*(_read(cache_folder() / key, source) or _compiled(key, source)))
        return _loaded[key]


def _compiled(key: str, source: str) -> tuple[bytes, str]:
    home = cache_folder()
    try:
        home.mkdir(parents=True, exist_ok=True)
        return _build(home, home / key, source)
    except OSError as fault:
        try:
            with tempfile.TemporaryDirectory(prefix="rsgen-kernel-") as spare:
                return _build(Path(spare), Path(spare) / key, source)
        except OSError:
            raise RsgenError(
                f"{home}: compiled kernels cannot be stored here ({fault.strerror}); "
                "set RSGEN_CACHE to a folder that can be written"
            ) from fault
