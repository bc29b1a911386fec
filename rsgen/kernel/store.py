"""Compiled kernels on disk: found by content, published whole, rebuilt when damaged.

A kernel lives in a folder of its own, named by the hash of everything that it depends on. It is compiled in a
temporary folder that is then renamed, so that parallel processes never see half a kernel; a list of checksums
inside tells damage from health before machine code is loaded.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from rsgen.errors import RsgenError

__all__ = ["cache_folder", "load_kernel"]

_CHECKSUMS = "checksums.json"
_FORMAT = "1"  # of the folder; raise it when its layout changes


def cache_folder() -> Path:
    """Where compiled kernels are kept: ``RSGEN_CACHE`` where it is set, else the user's cache folder."""
    chosen = os.environ.get("RSGEN_CACHE")
    if chosen:
        return Path(chosen)
    import platformdirs

    return Path(platformdirs.user_cache_dir("rsgen", appauthor=False))


def _key(source: str) -> str:
    import numba

    binding = import_module("llvmlite.binding")  # what numba itself compiles with
    parts = (
        _FORMAT,
        source,
        numba.__version__,
        binding.get_host_cpu_name(),
        # the features of a virtual machine can differ from those of its named processor
        binding.get_host_cpu_features().flatten(),
        sys.implementation.cache_tag,
    )
    return hashlib.sha256("\n".join(str(part) for part in parts).encode()).hexdigest()[:32]


def _digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder).as_posix()): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".py", ".nbi", ".nbc")
    }


def _healthy(folder: Path, source: str) -> bool:
    try:
        wanted = json.loads((folder / _CHECKSUMS).read_text(encoding="utf-8"))
        return (
            isinstance(wanted, dict)
            and (folder / "kernel.py").read_text(encoding="utf-8") == source
            and any(name.endswith(".nbc") for name in wanted)
            and _digests(folder) == wanted
        )
    except (OSError, ValueError):
        return False


def _import(folder: Path, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, folder / "kernel.py")
    if spec is None or spec.loader is None:
        raise RsgenError(f"{folder}: a kernel cannot be loaded from here; set RSGEN_CACHE to a plain folder")
    module = importlib.util.module_from_spec(spec)
    # numba finds the globals of cached functions by the name of their module
    sys.modules[name] = module
    written = sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(name, None)
        raise
    finally:
        sys.dont_write_bytecode = written
    return module


def _build(home: Path, target: Path, source: str, name: str) -> ModuleType:
    """Compile in a folder of our own and publish it; the module works even if publishing fails."""
    workshop = Path(tempfile.mkdtemp(dir=home, prefix=".building-"))
    try:
        (workshop / "kernel.py").write_text(source, encoding="utf-8")
        module = _import(workshop, name)
        (workshop / _CHECKSUMS).write_text(json.dumps(_digests(workshop), indent=0), encoding="utf-8")
        if target.exists():
            shutil.rmtree(target, ignore_errors=True)
        try:
            workshop.rename(target)
        except OSError:
            # another process was first; its kernel is as good
            shutil.rmtree(workshop, ignore_errors=True)
        return module
    except BaseException:
        shutil.rmtree(workshop, ignore_errors=True)
        raise


def _loaded(module: ModuleType) -> Callable[..., Any]:
    march: Callable[..., Any] = module.march
    return march


def load_kernel(source: str) -> Callable[..., Any]:
    """Load the compiled ``march`` of a kernel source; compile it first where the cache has none.

    Raises
    ------
    RsgenError
        The cache folder cannot be written and no other place is left.
    """
    key = _key(source)
    name = f"rsgen_kernel_{key}"
    if name in sys.modules:
        return _loaded(sys.modules[name])
    home = cache_folder()
    target = home / key
    if _healthy(target, source):
        try:
            return _loaded(_import(target, name))
        except Exception:
            # whatever numba dislikes in its own file, the source is still here
            sys.modules.pop(name, None)
    try:
        home.mkdir(parents=True, exist_ok=True)
        return _loaded(_build(home, target, source, name))
    except OSError as fault:
        try:
            with tempfile.TemporaryDirectory(prefix="rsgen-kernel-") as spare:
                return _loaded(_build(Path(spare), Path(spare) / key, source, name))
        except OSError:
            raise RsgenError(
                f"{home}: compiled kernels cannot be kept here ({fault.strerror}); "
                "set RSGEN_CACHE to a folder that can be written"
            ) from fault
