"""A folder whose files only its user can write; each carries a digest made with a key that nobody else reads.

Machine code is loaded from here and runs as the user. So a folder, a key or a file counts only when it
belongs to the user and nobody else can write it. That is asked of the opened descriptor, since what a name
means can change between two looks. A link, a pipe or a device is never followed, and the size of a file is
known before anything is read.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from rsgen.common.output import is_alive

__all__ = ["PrivateFolder", "UntrustedFolderError", "open_private_folder"]

_KEY, _KEY_BYTES = "key", 32
_DIGEST_BYTES = hashlib.sha256().digest_size

_MOST_BYTES = 16_000_000
"""A file; the machine code of the largest law that can be read has a tenth of it."""

_UNFINISHED = re.compile(r"\..+\.(?P<writer>\d+)\.[0-9a-f]+\.part")

_OTHERS_WRITE, _OTHERS_USE = 0o022, 0o077
_PLAIN = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)


class UntrustedFolderError(Exception):
    """A folder cannot be made, or somebody else could have written what is in it; the text says why."""


@dataclass(frozen=True, slots=True)
class PrivateFolder:
    """An opened folder of this user.

    Parameters
    ----------
    descriptor
        Of the folder; every file is opened relative to it.
    key
        Secret that all digests are made with.
    """

    descriptor: int
    key: bytes

    def read(self, name: str) -> bytes | None:
        """Read what ``write`` wrote under a name; None where it is missing, damaged or somebody else's."""
        whole = _read(self.descriptor, name, _OTHERS_WRITE)
        if whole is None or not hmac.compare_digest(
            whole[:_DIGEST_BYTES], self._digest(name, whole[_DIGEST_BYTES:])
        ):
            return None
        return whole[_DIGEST_BYTES:]

    def write(self, name: str, content: bytes) -> None:
        """Write a file whole, in place of what had the name.

        Raises
        ------
        OSError
            The disk is full, or a folder that is not empty has the name.
        """
        _write(self.descriptor, name, self._digest(name, content) + content)

    def _digest(self, name: str, content: bytes) -> bytes:
        return hmac.digest(self.key, name.encode() + b"\0" + content, "sha256")

    def clear(self) -> None:
        """Remove what killed writers left."""
        for name in os.listdir(self.descriptor):  # noqa: PTH208 - pathlib opens no descriptors
            found = _UNFINISHED.fullmatch(name)
            # of a writer on another machine it may be taken too soon; then its kernel is not stored
            if found and not is_alive(int(found["writer"])):
                with suppress(OSError):
                    os.unlink(name, dir_fd=self.descriptor)


@contextmanager
def open_private_folder(path: Path) -> Iterator[PrivateFolder]:
    """Open a folder of this user; make it, for this user alone, where it is missing.

    Raises
    ------
    UntrustedFolderError
        It cannot be made or opened, is a link or no folder, belongs to somebody else, others may write into
        it, or the system cannot say (Windows).
    """
    if os.name != "posix":
        raise UntrustedFolderError("this system does not say who else can write there")
    try:
        _make(path)
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | _PLAIN)
    except (OSError, ValueError) as fault:
        # O_NOFOLLOW refuses a link as if it were no folder
        raise UntrustedFolderError(f"no folder, or a link: {getattr(fault, 'strerror', fault)}") from fault
    try:
        found = os.fstat(descriptor)
        if found.st_uid != os.geteuid():
            raise UntrustedFolderError("it belongs to another user")
        if found.st_mode & _OTHERS_WRITE:
            raise UntrustedFolderError("other users may write into it")
        try:
            key = _key(descriptor)
        except OSError as fault:
            raise UntrustedFolderError(f"its key cannot be written: {fault.strerror or fault}") from fault
        folder = PrivateFolder(descriptor, key)
        folder.clear()
        yield folder
    finally:
        os.close(descriptor)


def _make(path: Path) -> None:
    """Make a folder and the missing ones above it; the umask decides nothing."""
    for folder in (*reversed(path.absolute().parents), path.absolute()):
        if not folder.exists():
            with suppress(FileExistsError):
                folder.mkdir(0o700)


def _key(descriptor: int) -> bytes:
    """Read the key; make one where there is none that is secret."""
    key = _read(descriptor, _KEY, _OTHERS_USE)
    if key is None or len(key) != _KEY_BYTES:
        _write(descriptor, _KEY, secrets.token_bytes(_KEY_BYTES))
        # of processes that begin at once, the last one has written the key
        key = _read(descriptor, _KEY, _OTHERS_USE)
    if key is None or len(key) != _KEY_BYTES:
        raise OSError("something else has its name")
    return key


def _read(folder: int, name: str, forbidden: int) -> bytes | None:
    """Read a plain file of this user that has none of the forbidden permissions."""
    try:
        descriptor = os.open(name, os.O_RDONLY | _PLAIN, dir_fd=folder)
    except OSError:
        return None
    try:
        found = os.fstat(descriptor)
        trusted = (
            stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & forbidden
        )
        if not trusted or found.st_size > _MOST_BYTES:
            return None
        return os.read(descriptor, found.st_size)
    except OSError:
        return None
    finally:
        os.close(descriptor)


def _write(folder: int, name: str, content: bytes) -> None:
    unfinished = f".{name}.{os.getpid()}.{secrets.token_hex(4)}.part"
    descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _PLAIN, 0o600, dir_fd=folder)
    try:
        with os.fdopen(descriptor, "wb") as file:
            # where the umask forbids even the owner
            os.fchmod(descriptor, 0o600)
            file.write(content)
        with suppress(OSError):
            # an empty folder that has taken the name; others stay, and the file is not stored
            os.rmdir(name, dir_fd=folder)
        os.rename(unfinished, name, src_dir_fd=folder, dst_dir_fd=folder)
    except BaseException:
        with suppress(OSError):
            os.unlink(unfinished, dir_fd=folder)
        raise
