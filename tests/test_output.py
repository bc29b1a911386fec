"""A file is whole or not there: the law of rsgen.common.output."""

import errno
import os

import pytest

from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic


@pytest.mark.skipif(os.name != "posix", reason="permissions are POSIX, and links need rights elsewhere")
def test_a_link_is_replaced_by_a_file_with_the_mode_of_a_plain_one_and_its_target_untouched(tmp_path):
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "report.html").symlink_to(tmp_path / "precious")
    write_atomic(tmp_path / "report.html", "report")
    assert (tmp_path / "precious").read_text() == "precious"
    assert not (tmp_path / "report.html").is_symlink()
    assert (tmp_path / "report.html").read_text() == "report"
    assert (tmp_path / "report.html").stat().st_mode == (tmp_path / "precious").stat().st_mode


def test_missing_folder_and_folder_in_the_way_are_sentences(tmp_path):
    with pytest.raises(RsgenError, match="cannot be written"):
        write_atomic(tmp_path / "none" / "a", "x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RsgenError, match="no regular file"):
        write_atomic(tmp_path / "folder", "x")
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


def test_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    target = tmp_path / "report.html"
    target.write_text("old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RsgenError, match=r"report\.html: cannot be written: No space left"):
        write_atomic(target, "n" * 100_000)
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
