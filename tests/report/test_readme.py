"""Every command and every line of Python in README.md runs, in a folder of its own."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Answer

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(?P<kind>sh|python)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
# `make test` would run this test again, and `make reports` makes a new environment from the network first
NOT_HERE = ("make ",)
PROGRAM = ".venv/bin/rsgen"
SECONDS = 300
MOST_BYTES = 150_000  # of a picture: the repository keeps every version


def blocks(kind: str) -> list[str]:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return [match["text"] for match in BLOCK.finditer(text) if match["kind"] == kind]


def commands() -> list[list[str]]:
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    split = [shlex.split(line, comments=True) for line in lines if not line.startswith(NOT_HERE)]
    return [words for words in split if words]


def run(words: list[str], folder: Path) -> None:
    done = subprocess.run(
        words,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=SECONDS,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
    assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"


def test_what_the_readme_links_to_is_there_and_small() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)]*)\)", text) if "://" not in link]
    assert [link for link in links if not (ROOT / link).is_file()] == []
    pictures = [ROOT / link for link in links if link.endswith(".png")]
    assert len(pictures) == 4
    assert all(picture.stat().st_size < MOST_BYTES for picture in pictures)


def test_there_are_commands_and_a_program() -> None:
    assert len(commands()) >= 4
    assert len(blocks("python")) >= 2


@pytest.mark.slow
def test_all_commands_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_cli: Callable[..., Answer]
) -> None:
    """Run the commands in their order, for later ones read what earlier ones wrote."""
    shutil.copytree(ROOT / "cases", tmp_path / "cases")
    monkeypatch.chdir(tmp_path)
    for words in commands():
        assert words[0] == PROGRAM, f"{shlex.join(words)}: only commands of rsgen can be tried here"
        done = run_cli(*words[1:])
        assert done.code == 0, f"{shlex.join(words)}\n{done.out}\n{done.err}"
    results = list(tmp_path.glob("reports/*/result.json"))
    assert results
    for result in results:
        assert result.parent.joinpath("report.html").is_file()


@pytest.mark.slow
def test_the_program_runs(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "cases", tmp_path / "cases")
    (tmp_path / "reports").mkdir()
    for program in blocks("python"):
        # a warning is a fault of the example as well
        run([sys.executable, "-W", "error", "-c", program], tmp_path)
    assert (tmp_path / "reports" / "cubic" / "report.html").is_file()
