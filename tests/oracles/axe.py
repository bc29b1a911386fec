"""axe-core, the usual judge of accessibility, for the browser tests; fetched by npm once, then kept."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path

import platformdirs

VERSION = "4.10.3"
_SECONDS = 60


@functools.cache
def find_axe() -> str | None:
    """The source of axe-core; None where it is neither kept here nor npm can fetch it."""
    kept = Path(platformdirs.user_cache_dir("rsgen"), "tests", f"axe-core-{VERSION}.js")
    if not kept.is_file():
        npm = shutil.which("npm")
        if npm is None:
            return None
        with tempfile.TemporaryDirectory() as folder:
            command = [npm, "pack", "--silent", f"axe-core@{VERSION}"]
            try:
                subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=_SECONDS)
                with tarfile.open(Path(folder, f"axe-core-{VERSION}.tgz")) as archive:
                    member = archive.extractfile("package/axe.min.js")
                    source = member.read() if member else b""
            except (OSError, subprocess.SubprocessError, tarfile.TarError, KeyError):
                return None
        kept.parent.mkdir(parents=True, exist_ok=True)
        part = kept.with_suffix(f".{os.getpid()}")
        part.write_bytes(source)
        part.replace(kept)
    return kept.read_text(encoding="utf-8")
