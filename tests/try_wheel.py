"""Build the sdist and the wheel and use the wheel as a stranger would: ``make test-wheel``.

Each Python that pyproject.toml names and that is found here gets an empty environment with the wheel; there
every module is imported and the commands are run. One more environment has the lowest declared versions of
the dependencies, another those of constraints.txt.
``python tests/try_wheel.py --this`` tries only the Python that runs it, with neither git, make nor a shell:
that is how the workflow uses it on Windows and macOS.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SECONDS = 600  # of a step; longer ones hang: the slowest, installing over a slow line, takes a minute or two
_CLASSIFIER = "Programming Language :: Python :: "

# imports every module: a dependency that pyproject.toml does not declare is missed here
MODULES = """
import importlib, pkgutil, sys, pathlib, rsgen
place = pathlib.Path(rsgen.__file__).resolve()
assert place.is_relative_to(pathlib.Path(sys.prefix).resolve()), f"{place}: not the installed package"
names = [m.name for m in pkgutil.walk_packages(rsgen.__path__, "rsgen.") if not m.name.endswith("__main__")]
for name in names:
    importlib.import_module(name)
missing = [name for name in rsgen.__all__ if not hasattr(rsgen, name)]
assert not missing, missing
print(len(names))
"""
# pip cannot choose the lowest versions
UV = (sys.executable, "-m", "uv", "pip", "install", "--quiet")
LOWEST = ("--resolution", "lowest-direct")


class WheelError(Exception):
    """The package does not work outside its repository."""


Environment = tuple[str, str, tuple[str, ...]]
"""An empty one to be: its name, the Python it is made with, and how the packages are chosen."""


def declared_versions() -> list[str]:
    """Return the versions of Python that pyproject.toml promises, lowest first."""
    classifiers = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["classifiers"]
    named = [text.removeprefix(_CLASSIFIER) for text in classifiers if text.startswith(_CLASSIFIER)]
    return sorted(named, key=lambda version: tuple(map(int, version.split("."))))


def find_python(version: str) -> str | None:
    """Find an interpreter of a version that can make environments: this one, on the PATH, or of pyenv."""
    probe = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    folders = [Path(folder, f"python{version}") for folder in os.environ.get("PATH", "").split(os.pathsep)]
    own = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob(f"versions/{version}.*/bin/python")
    for path in (sys.executable, *filter(Path.is_file, folders), *sorted(own, reverse=True)):
        # a shim of pyenv answers with an error where its version is not switched on
        with suppress(OSError):
            answer = subprocess.run([path, "-c", probe], capture_output=True, text=True, timeout=60)
            if answer.stdout.strip() == version:
                return str(path)
    return None


def clean_environment(home: Path) -> dict[str, str]:
    """Return the variables of this process without what would lead back to the repository or its settings."""
    leads = ("PYTHON", "VIRTUAL_ENV", "RSGEN_", "NUMBA_", "MPL", "COVERAGE", "PYTEST")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(leads)}
    return kept | {"RSGEN_CACHE": str(home / "cache"), "PYTHONUTF8": "1", "PYTHONWARNINGS": "error"}


def call(words: Sequence[str | Path], folder: Path, **added: str) -> str:
    """Run a program in a folder, return what it printed; WheelError where it ends badly or not at all."""
    texts = [str(word) for word in words]
    shown = " ".join([Path(texts[0]).name, *texts[1:]])[:200]
    try:
        done = subprocess.run(
            texts, cwd=folder, env=clean_environment(folder) | added, capture_output=True, text=True,
            encoding="utf-8", errors="replace", timeout=SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise WheelError(f"{shown}: not finished after {SECONDS} s") from None
    if done.returncode:
        raise WheelError(f"{shown}: ends with {done.returncode}\n{done.stdout}\n{done.stderr}")
    return done.stdout + done.stderr


def files_of(folder: str) -> set[str]:
    found = (path for path in (ROOT / folder).rglob("*") if path.is_file())
    return {path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts}


def build(out: Path) -> Path:
    """Build the wheel; hold what is packed against the repository: package and examples, nothing else."""
    call([sys.executable, "-m", "build", "--outdir", out, ROOT], out.parent, PYTHONWARNINGS="default")
    (sdist,), (wheel,) = out.glob("*.tar.gz"), out.glob("*.whl")
    package, cases = files_of("rsgen"), files_of("cases")
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    wanted = package | {name.replace("cases/", "rsgen/examples/", 1) for name in cases}
    if packed != wanted:
        raise WheelError(f"{wheel.name}: differs from the folders rsgen and cases: {sorted(packed ^ wanted)}")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    texts = {"README.md", "LICENSE", "CITATION.cff", "CHANGELOG.md"}
    texts |= {"pyproject.toml", "constraints.txt", "tests/conftest.py", "Makefile"}
    if missing := (package | cases | texts) - names:
        raise WheelError(f"{sdist.name}: lacks {sorted(missing)}")
    print(f"built {sdist.name} and {wheel.name}", flush=True)
    return wheel


def install(environment: Environment, wheel: Path, folder: Path) -> Path:
    (_, made_with, options), place = environment, folder / "venv"
    call([made_with, "-m", "venv", place], folder)
    python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    words: list[str | Path] = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if options == LOWEST:
        words = [*UV, "--python", python]
    call([*words, *options, wheel], folder, PYTHONWARNINGS="default")
    return python


def use(python: Path, version: str, folder: Path) -> None:
    """Use the installed package: modules, commands, a simulated case and a measured one."""
    rsgen = python.with_name("rsgen.exe" if os.name == "nt" else "rsgen")
    call([python, "-I", "-c", MODULES], folder, PYTHONWARNINGS="default")
    for words in ([rsgen], [python, "-m", "rsgen"]):
        told = call([*words, "--version"], folder).strip()
        if told != f"rsgen {version}":
            raise WheelError(f"{words[-1]} --version: {told!r}, and the wheel is of {version}")
    for command, part in ((["laws"], "cubic-spring"), (["derive", "k*x + kn*x**3 + c*v"], "closed form")):
        if part not in (text := call([rsgen, *command], folder)):
            raise WheelError(f"{part!r} is not in:\n{text}")
    call([rsgen, "init", "small.toml"], folder)
    call([rsgen, "examples", "."], folder)
    # a measured case: its binary file is read in the confined process, which must find the installed package
    for case, state in (("small.toml", "accepted"), ("cases/formats/mat-struct.toml", "identified")):
        call([rsgen, "run", case, "--out", "out", "--jobs", "1"], folder)
        place = folder / "out" / Path(case).stem
        found = json.loads((place / "result.json").read_text(encoding="utf-8"))["verdict"]
        if found["state"] != state or not (place / "report.html").is_file():
            raise WheelError(f"{case}: {found['headline']}; {state} is expected, and a report")


def environments(only_this: bool) -> tuple[list[Environment], list[str]]:
    """Return the environments to try and the versions of Python that are not found here."""
    if only_this:
        return [("this Python", sys.executable, ())], []
    found = {version: find_python(version) for version in declared_versions()}
    made = [(f"Python {version}", path, ()) for version, path in found.items() if path]
    if lowest := found[declared_versions()[0]]:
        # newer versions of Python have no binary packages of the oldest versions of the dependencies
        made.append(("lowest versions", lowest, LOWEST))
    pinned = ("--constraint", str(ROOT / "constraints.txt"))
    made.append(("constraints.txt", sys.executable, pinned))
    return made, [f"not found here: Python {version}" for version, path in found.items() if not path]


def tried(environment: Environment, wheel: Path, folder: Path) -> bool:
    """Install and use the wheel in an environment, print how that went, and return True if it works."""
    folder.mkdir()
    begin, result = time.monotonic(), "works"
    try:
        use(install(environment, wheel, folder), wheel.name.split("-")[1], folder)
    except WheelError as fault:
        result = f"DOES NOT WORK: {fault}"
    print(f"{environment[0]}: {result} ({time.monotonic() - begin:.0f} s)", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    return result == "works"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--this", action="store_true", help="try only the Python that runs this")
    chosen, absent = environments(parser.parse_args().this)
    with tempfile.TemporaryDirectory(prefix="rsgen-wheel-", ignore_cleanup_errors=True) as made:
        place = Path(made)
        (place / "dist").mkdir()
        try:
            wheel = build(place / "dist")
        except WheelError as fault:
            print(fault)
            return 1
        try:
            # uv does not know the settings of pip
            call([*UV, "--target", place / "probe", "--dry-run", "--no-deps", "sympy"], place)
        except WheelError:
            chosen = [environment for environment in chosen if environment[2] != LOWEST]
            absent.append("uv reaches no packages: lowest versions")
        works = [tried(one, wheel, place / str(number)) for number, one in enumerate(chosen)]
    for reason in absent:
        print(f"NOT TRIED, {reason}")
    return 0 if all(works) else 1


if __name__ == "__main__":
    sys.exit(main())
