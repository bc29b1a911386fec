"""A file is whole or not there: the law of rsgen.common.output."""

import os
import subprocess
import sys

import pytest

from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic


@pytest.mark.skipif(os.name != "posix", reason="permissions are POSIX")
def test_mode_is_that_of_a_plain_file(tmp_path):
    (tmp_path / "plain").write_text("x")
    write_atomic(tmp_path / "atomic", "x")
    assert (tmp_path / "plain").stat().st_mode == (tmp_path / "atomic").stat().st_mode


@pytest.mark.skipif(os.name != "posix", reason="symbolic links need rights elsewhere")
def test_a_link_is_replaced_and_its_target_untouched(tmp_path):
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "report.html").symlink_to(tmp_path / "precious")
    write_atomic(tmp_path / "report.html", "report")
    assert (tmp_path / "precious").read_text() == "precious"
    assert not (tmp_path / "report.html").is_symlink()
    assert (tmp_path / "report.html").read_text() == "report"


def test_missing_folder_and_folder_in_the_way_are_sentences(tmp_path):
    with pytest.raises(RsgenError, match="cannot be written"):
        write_atomic(tmp_path / "none" / "a", "x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RsgenError, match="no regular file"):
        write_atomic(tmp_path / "folder", "x")
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


_FULL = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic
try:
    write_atomic(sys.argv[1], "n" * 100000)
except RsgenError as fault:
    print(fault); sys.exit(7)
"""


@pytest.mark.skipif(os.name != "posix", reason="the limit stands for a full disk and is POSIX")
def test_full_disk_leaves_the_old_file(tmp_path):
    target = tmp_path / "report.html"
    target.write_text("old")
    run = subprocess.run(
        [sys.executable, "-c", _FULL, str(target)], capture_output=True, text=True, check=False
    )
    assert run.returncode == 7, run.stderr
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
