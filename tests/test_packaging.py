"""What is declared about the package at several places is the same everywhere."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import rsgen
from tests.try_wheel import declared_versions

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
OF_A_RUN = [*PROJECT["dependencies"], *(wanted for extra in ("tdms", "xlsx") for wanted in EXTRAS[extra])]


def test_the_workflow_tries_every_declared_python_on_every_system():
    workflow = (ROOT / ".github" / "workflows" / "check.yml").read_text(encoding="utf-8")
    matrices = re.findall(r"^ +python: \[(.*)\]$", workflow, re.MULTILINE)
    assert [re.findall(r'"([\d.]+)"', matrix) for matrix in matrices] == [declared_versions()] * 2
    assert "system: [ubuntu-latest, macos-latest, windows-latest]" in workflow
    assert PROJECT["requires-python"] == f">={declared_versions()[0]}"


@pytest.mark.parametrize("version", declared_versions())
@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
def test_the_constraints_name_a_version_of_each_dependency_that_is_allowed(version, system):
    surroundings = {"python_version": version, "python_full_version": f"{version}.0", "sys_platform": system}
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    entries = [Requirement(line) for line in lines if line and not line.startswith("#")]
    pinned: dict[str, str] = {}
    for entry in entries:
        (pin,) = entry.specifier
        assert pin.operator == "=="
        if entry.marker is None or entry.marker.evaluate(surroundings):
            assert entry.name not in pinned
            pinned[entry.name] = pin.version
    for wanted in map(Requirement, OF_A_RUN):
        assert wanted.specifier.contains(pinned[wanted.name]), "renew it: make constraints"


def test_every_dependency_has_a_lowest_version_and_no_highest():
    for wanted in map(Requirement, (*OF_A_RUN, *EXTRAS["test"])):
        assert [clause.operator for clause in wanted.specifier] == [">="] or wanted.name == "rsgen"


def test_the_citation_is_of_the_last_version_in_the_changelog_and_the_package_knows_its_own():
    assert rsgen.__version__ == importlib.metadata.version("rsgen")
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version, date = re.search(r"^## (\d+\.\d+\.\d+) \((\S+)\)$", changes, re.MULTILINE).groups()
    assert {f"version: {version}", f"date-released: {date}"} <= {*cited.splitlines()}
    assert f"version {version}" in (ROOT / "README.md").read_text(encoding="utf-8")
