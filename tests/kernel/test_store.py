"""The cache of machine code: used again, compiled anew after damage, never loaded from where others write."""

import os
import stat
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from rsgen.app.cli.progress_bar import print_cache_fault
from rsgen.dynamics import kernel as compiled
from rsgen.dynamics.kernel_source import MemoryRows, generate
from rsgen.formula.reading import parse
from tests.programs import python

pytestmark = pytest.mark.skipif(os.name != "posix", reason="without owners of files there is no cache")


def _one_step_further(source: str) -> np.ndarray:
    kernel = compiled.Kernel(("c", "k"), MemoryRows(0, 0), compiled.load_kernel(source))
    # as a new process would: from the cache, if there is one
    compiled._loaded.clear()
    values = np.array([0.3, 40.0])
    return kernel.integrate(
        np.array([0]), np.zeros((2, 1)), np.array([[1.0, 0.0]]), np.array([6.0]), 1.0, values,
        steps=32, periods=1,
    ).state  # fmt: skip


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RSGEN_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def entry_of(cache: Path) -> Path:
    (entry,) = cache.glob("[!.]*")
    return entry


def _replaced(make: Callable[[Path], object]) -> Callable[[Path], object]:
    return lambda entry: (entry.unlink(), make(entry))


def _flip(entry: Path, place: int) -> None:
    content = bytearray(entry.read_bytes())
    content[place] ^= 0xFF
    entry.write_bytes(content)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "digest": lambda entry: _flip(entry, 0), "code": lambda entry: _flip(entry, -2000),
    "cut in the digest": lambda entry: entry.write_bytes(entry.read_bytes()[:20]),
    "longer": lambda entry: entry.write_bytes(entry.read_bytes() + b"more"),
    "empty": lambda entry: entry.write_bytes(b""), "missing": Path.unlink,
    "huge": lambda entry: os.truncate(entry, 10**12), "writable by others": lambda entry: entry.chmod(0o666),
    "pipe": _replaced(os.mkfifo), "folder": _replaced(Path.mkdir),
    "link to a device": _replaced(lambda path: path.symlink_to("/dev/zero")),
    "link to the right code": lambda entry: (
        entry.rename(entry.parent.parent / "elsewhere"),
        entry.symlink_to(entry.parent.parent / "elsewhere"),
    ),
    "writable by a group": lambda entry: entry.chmod(0o620),
}  # fmt: skip


@pytest.fixture(scope="module")
def compiled_once():
    source = generate(parse("c*v + k*x")) + "\n# a kernel that is damaged\n"
    return source, compiled.compile_source(source, "rsgen_kernel_damaged")


@pytest.mark.slow
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_kernel_is_compiled_again(own_cache, compiled_once, monkeypatch, damage):
    source, code = compiled_once
    compilations = []
    monkeypatch.setattr(compiled, "compile_source", lambda *given: compilations.append(given) or code)
    expected = _one_step_further(source)
    DAMAGES[damage](entry_of(own_cache))
    for _ in range(2):
        assert np.array_equal(_one_step_further(source), expected)
    # once at first, once after the damage; then it is stored again, and not compiled any more
    assert len(compilations) == 2
    assert sorted(path.name for path in own_cache.iterdir()) == [entry_of(own_cache).name]


def _plant(cache: Path, content: bytes, mode: int = 0o700, name: str = "") -> None:
    """Write code with its digest, as somebody does who can write into the folder, whose mode is changed."""
    cache.chmod(mode)
    owner = cache.stat().st_uid
    with (
        patch.object(compiled, "_OTHERS_WRITE", 0),
        patch.object(os, "geteuid", lambda: owner),
        compiled.open_private_folder(cache) as folder,
    ):
        folder.write(name or entry_of(cache).name, content)


def _move(cache: Path, content: bytes) -> None:
    """A true entry, with a true digest, gets the name of another kernel."""
    entry = entry_of(cache)
    _plant(cache, content, name="another")
    (cache / "another").replace(entry)


def _link(cache: Path, content: bytes) -> None:
    _plant(cache, content)
    cache.symlink_to(cache.rename(cache.with_name("real")))


def _give_away(cache: Path, content: bytes, *paths: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("the administrator alone gives files away")
    _plant(cache, content)
    for path in (entry_of(cache), *paths):
        os.chown(path, 12345, 12345)


WAYS: dict[str, Callable[[Path, bytes], object]] = {
    "digest of the true code in front": lambda cache, content: entry_of(cache).write_bytes(
        entry_of(cache).read_bytes()[:32] + content
    ),
    "entry of another kernel": _move, "folder that all can write": lambda *to: _plant(*to, 0o777),
    "folder that a group can write": lambda *to: _plant(*to, 0o770),
    "folder as /tmp is": lambda *to: _plant(*to, 0o1777), "link to a folder": _link,
    "folder of another user": lambda *to: _give_away(*to, to[0]), "entry of another user": _give_away,
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_a_planted_kernel_is_never_loaded(own_cache, compiled_once, monkeypatch, way):
    source, code = compiled_once
    loaded: list[bytes] = []
    monkeypatch.setattr(compiled, "compile_source", lambda *given: code)
    load = compiled.load_object
    monkeypatch.setattr(compiled, "load_object", lambda *given: loaded.append(given[0]) or load(*given))
    expected = _one_step_further(source)
    WAYS[way](own_cache, code[1].encode() + b"\0planted")
    loaded.clear()
    assert np.array_equal(_one_step_further(source), expected)
    assert loaded == [code[0]]
    if "folder" in way:
        assert compiled.cache_fault() is not None


def test_without_a_place_for_the_cache_kernels_still_work(own_cache, compiled_once, monkeypatch, capsys):
    own_cache.write_text("")
    source, code = compiled_once
    monkeypatch.setattr(compiled, "compile_source", lambda *given: code)
    assert np.isfinite(_one_step_further(source)).all()
    print_cache_fault()
    assert f"{own_cache}: " in capsys.readouterr().err
    # nor where a folder that cannot be taken away has the name of the entry
    own_cache.unlink()
    _one_step_further(source)
    entry = entry_of(own_cache)
    entry.unlink()
    (entry / "more").mkdir(parents=True)
    assert np.isfinite(_one_step_further(source)).all()


@pytest.mark.thorough
def test_parallel_processes_share_one_cache_and_later_ones_need_no_compiler(own_cache):
    program = (
        "import sys; from rsgen.formula.reading import parse; "
        "from rsgen.dynamics.kernel import compile_kernel; "
        "print(compile_kernel(parse('c*v + k*x')).parameters, 'numba' in sys.modules)"
    )
    with ThreadPoolExecutor() as threads:
        said = [done.stdout.strip() for done in threads.map(python, ["-c"] * 2, [program] * 2)]
    # the first compiles, the other may have come after it
    assert "('c', 'k') True" in said
    assert {text.rpartition(" ")[0] for text in said} == {"('c', 'k')"}
    assert entry_of(own_cache).is_file()
    assert python("-c", program).stdout.strip() == "('c', 'k') False"


def test_a_cache_is_made_for_its_user_alone(own_cache):
    mask = os.umask(0)
    try:
        compiled.cache_fault()
    finally:
        os.umask(mask)
    assert stat.S_IMODE(own_cache.stat().st_mode) == 0o700
    with compiled.open_private_folder(own_cache) as folder:
        folder.write("one", b"content")
        os.mkfifo(own_cache / "pipe")
        assert compiled._read(folder.descriptor, "pipe") is None
    assert stat.S_IMODE((own_cache / "one").stat().st_mode) == 0o600


def test_what_killed_writers_left_is_removed(own_cache, dead):
    with compiled.open_private_folder(own_cache) as folder:
        for process in (dead, os.getppid()):
            (own_cache / f".a.{process}.0.part").touch()
        (own_cache / ".part").touch()
        folder.write("entry", b"content")
        assert folder.read("entry") == b"content"
        assert folder.read("other") is None
    # the next one to open it clears up, whether it writes or not
    with compiled.open_private_folder(own_cache):
        left = sorted(path.name for path in own_cache.iterdir())
    assert left == sorted([f".a.{os.getppid()}.0.part", ".part", "entry"])


@pytest.mark.parametrize("where", ["/dev/null/cache", "/proc/cache", "x" * 300, "a\ud800b"])
def test_a_folder_that_cannot_be_is_a_reason(where):
    with pytest.raises(compiled.UntrustedFolderError), compiled.open_private_folder(Path(where)):
        pass
