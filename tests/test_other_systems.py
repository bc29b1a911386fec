"""rsgen without what only POSIX systems have: what of Windows can be shown here."""

import json
import os
from pathlib import Path

import pytest

from rsgen.files import sandbox
from tests.case_files import CUBIC, GONE, write_small
from tests.programs import python

ROOT = Path(__file__).resolve().parent.parent

ELSEWHERE = '''
"""Take away what Windows lacks, once the libraries that know Windows themselves are loaded."""
import importlib, importlib.abc, os, pathlib, shutil, signal, subprocess, sys, tempfile
for library in LIBRARIES:
    importlib.import_module(library)

MODULES = {"crypt", "fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
OF_OS = (
    "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "chown", "fchmod", "fork", "geteuid", "getgid",
    "getuid", "killpg", "lchown", "mkfifo", "openpty", "posix_spawn", "sched_getaffinity", "setsid",
    "statvfs", "uname",
)
OF_SIGNAL = (
    "SIGALRM", "SIGCHLD", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGXCPU",
    "alarm", "pthread_sigmask", "setitimer", "sigwait",
)

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}, as on Windows", name=name)

for name in MODULES:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Absent())
for place, names in ((os, OF_OS), (signal, OF_SIGNAL)):
    for name in names:
        if hasattr(place, name):
            delattr(place, name)
# Windows opens no folders, and paths cannot be turned into those of Windows here
def no_folders(path, *rest, _open=os.open, **more):
    if "dir_fd" in more or os.path.isdir(path):
        raise PermissionError(13, "Permission denied", path)
    return _open(path, *rest, **more)
os.open = no_folders
shutil._use_fd_functions = False
os.name = "nt-like"
'''

LIBRARIES = (
    "h5py", "IPython", "matplotlib.pyplot", "numba", "platformdirs.unix", "scipy.io", "scipy.optimize",
)  # fmt: skip


def run_elsewhere(program: str, folder: Path, libraries: tuple[str, ...] = LIBRARIES, **options: object):
    head = f"import sys; sys.path.insert(0, {str(ROOT)!r})\nLIBRARIES = {libraries!r}"
    script = f"{head}\n{ELSEWHERE}\n{program}"
    (folder / "elsewhere.py").write_text(script, encoding="utf-8")
    # otherwise the cache folder is one of this system
    environment = {**os.environ, "RSGEN_CACHE": str(folder / "cache")}
    return python("elsewhere.py", cwd=folder, env=environment, text=False, **options)


@pytest.mark.thorough
def test_a_case_goes_to_its_report_without_posix(tmp_path):
    write_small(tmp_path, changes=CUBIC | {"accept": {"m": 1e-4, "k": 1e-4}, "test.accuracy": GONE})
    program = """
import importlib, pkgutil, rsgen
for module in pkgutil.walk_packages(rsgen.__path__, "rsgen."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
from rsgen.app.cli import main
main(['run', 'small.toml', '--out', 'out', '--jobs', '1'])
"""
    done = run_elsewhere(program, tmp_path)
    assert done.returncode == 0, done.stderr.decode()
    result = json.loads((tmp_path / "out" / "small" / "result.json").read_text(encoding="utf-8"))
    assert result["verdict"]["state"] == "accepted"
    assert b"does not say who else can write there" in done.stderr, "the cache that is not used is said"


@pytest.mark.slow
def test_a_binary_file_is_read_where_nothing_can_be_limited(tmp_path):
    order = json.dumps({"format": "mat", "wanted": None})
    program = f"sys.argv[1:] = [{order!r}]\nfrom rsgen.files.sandbox import main; main()"
    with (ROOT / "cases" / "formats" / "table.mat").open("rb") as file:
        done = run_elsewhere(program, tmp_path, ("scipy.io",), stdin=file)
    header, *_ = done.stdout.split(b"\n")
    assert json.loads(header)["entries"]


@pytest.mark.slow
def test_inspect_says_what_is_not_limited(run_cli, monkeypatch):
    formats = ROOT / "cases" / "formats"
    assert "limits" not in run_cli("inspect", formats / "table.mat").err
    monkeypatch.setattr(sandbox, "MEMORY_STATUS", "/no/such/file")
    assert "limits everything but the memory" in run_cli("inspect", formats / "table.mat").err
    assert "limits" not in run_cli("inspect", formats / "table.csv").err
    monkeypatch.setattr(sandbox, "find_spec", lambda name: None)
    assert "limits nothing but the time" in run_cli("inspect", formats / "table.mat").err
