"""Ways to make rsgen delete or overwrite what the user has: whole commands, every file compared.

``python -m tests.attacks output``
"""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

from rsgen.app.study.folder import read_manifest
from tests.attacks import program
from tests.attacks.program import Row

NO_PROCESS = 4_194_303
"""A number of a process that hardly is one: of a run that seems to have been killed."""

MANIFEST = '{"schema": 1, "files": {"../thesis.tex": "0"}}'


def _mine(path: Path, text: str = "three years of work") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _instead(small: Path, *files: str) -> None:
    """Lay files of the user in place of a result; "" is the folder itself."""
    shutil.rmtree(small)
    for name in files:
        _mine(small / name if name else small, MANIFEST if name == "manifest.json" else "three years of work")


def _link(place: Path, target: Path) -> None:
    """Lay a link to a file of the user, or to the folder of one, in place of what a run wrote."""
    _mine(target / "thesis.tex" if place.is_dir() else target)
    shutil.rmtree(place) if place.is_dir() else place.unlink()
    place.symlink_to(target)


def _killed_between_renames(out: Path) -> None:
    _mine(out / "small" / "remarks.txt")
    shutil.copytree(out / "small", out / f".small.{NO_PROCESS}.old")


WAYS: dict[str, Callable[[Path, Path], object]] = {
    "folder of the user": lambda out, small: _instead(small, "thesis.tex"),
    "file of the user": lambda out, small: _instead(small, ""),
    "file inside a result": lambda out, small: _mine(small / "remarks.txt"),
    "hidden file inside a result": lambda out, small: _mine(small / ".git" / "HEAD"),
    "changed report": lambda out, small: _mine(
        small / "report.html", (small / "report.html").read_text(encoding="utf-8") + "<!-- my remarks -->"
    ),
    "changed notebook": lambda out, small: _mine(small / "notebook.ipynb"),
    "manifest that lists other files": lambda out, small: _instead(small, "thesis.tex", "manifest.json"),
    "link for a result": lambda out, small: _link(small, out.parent / "elsewhere"),
    "link inside a result": lambda out, small: _link(small / "report.html", out.parent / "thesis.tex"),
    "index of the user": lambda out, small: _mine(out / "index.html", "<html>my home page</html>"),
    "link for the index": lambda out, small: _link(out / "index.html", out.parent / "home.html"),
    "folder named as an unfinished one": lambda out, small: _mine(
        out / f".small.{NO_PROCESS}.part" / "thesis.tex"
    ),
    "folder named as one moved away": lambda out, small: _mine(
        out / f".small.{NO_PROCESS}.old" / "thesis.tex"
    ),
    "remarks in a result that was moved away": lambda out, small: _killed_between_renames(out),
}
"""What lays something of the user where a run writes: in the folder of results, or in an earlier result."""


def _belongings(place: Path) -> dict[str, str]:
    """Give every file of the user below a folder with what is in it; links are not followed."""
    found = {}
    for path in sorted(place.rglob("*")):
        if path.is_symlink():
            found[str(path)] = str(path.readlink())
        elif path.is_file():
            text = path.read_bytes().decode("utf-8", "replace")
            if "my " in text[-4000:] or "three years" in text or "small-failed" in path.name:
                found[str(path)] = text
    return found


def _missing(before: dict[str, str], place: Path) -> list[str]:
    """List what the user had and has no more, under any name."""
    after = _belongings(place)
    return [path for path, text in before.items() if after.get(path) != text and text not in after.values()]


def attack_once(way: str, finished: Path) -> tuple[list[str], program.Ended]:
    """Lay the user's files, run with ``--force``; return what is lost, and how the run ended."""
    with program.temporary() as place:
        for name in ("cases", "out", "cache"):
            shutil.copytree(finished / name, place / name)
        out, small = place / "out", place / "out" / "small"
        words = ("run", place / "cases" / "small.toml", "--force", "--out", out)
        if way == DURING:
            process = program.start(words, env=program.environment(place))
            until = time.monotonic() + 20 * program.ORPHAN_SECONDS
            while not list(out.glob(".small.*.part")) and time.monotonic() < until:
                time.sleep(0.01)
            _mine(small / "thesis.tex")
            before = _belongings(place)
            ended = program.end(process)
        else:
            WAYS[way](out, small)
            before = _belongings(place)
            ended = program.rsgen(*words, env=program.environment(place))
        if not before:
            raise RuntimeError(f"{way}: laid nothing")
        return _missing(before, place), ended


DURING = "file saved during a run"


def prepare(finished: Path) -> None:
    (finished / "cases").mkdir()
    program.write_case(finished / "cases")
    words = ("run", finished / "cases", "--out", finished / "out")
    ended = program.rsgen(*words, env=program.environment(finished))
    if ended.fault(0) or read_manifest(finished / "out" / "small") is None:
        raise RuntimeError(f"an undisturbed run failed: {ended.fault(0)}")


def run(count: int, seed: int) -> list[Row]:
    """Try the first ``count`` ways; nothing here is left to chance."""
    lost, talk = [], []
    ways = [*WAYS, DURING][:count]
    with program.temporary() as finished:
        prepare(finished)
        for way in ways:
            gone, ended = attack_once(way, finished)
            lost += [f"{way}: {Path(path).name}" for path in gone]
            # a file that comes during a run is noticed: the run is refused
            fault = ended.fault(*(2,) if way == DURING else (0, 2))
            talk += [f"{way}: {fault}"] * bool(fault)
    figure = f"files of the user where a run with --force writes, {len(ways)} ways"
    return [
        program.failures(f"{figure}: deleted or changed", lost),
        program.failures(f"{figure}: tracebacks, hangs, wrong exit codes", talk),
    ]
