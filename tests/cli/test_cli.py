"""The command line: answers on standard output, one sentence a fault on standard error, honest exit codes."""

import json
import os
import re
import shutil
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest

from rsgen import __version__
from rsgen.app.cli.application import COMMANDS
from rsgen.app.study.folder import read_manifest
from tests.case_files import write_small
from tests.programs import RSGEN, python, shell
from tests.try_wheel import files_of

ROOT = Path(__file__).parents[2]
posix = pytest.mark.skipif(os.name != "posix", reason="signals, terminals and owners of files are POSIX")


def test_help_is_quick_and_teaches():
    before, run, after = os.times(), shell("--help"), os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    # of the processor: the promise is 0.3 s on a quiet machine; a busy one gets air
    assert spent < 1.0
    assert (run.returncode, run.stderr) == (0, "")
    assert set(COMMANDS) <= set(re.findall(r"^  (\w+) ", run.stdout, re.MULTILINE))
    assert "rsgen init gearbox" in run.stdout
    run = python("-m", "rsgen", "--version")
    assert (run.returncode, run.stdout, run.stderr) == (0, f"rsgen {__version__}\n", "")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_an_example(command, run_cli):
    shown = run_cli(command, "--help")
    assert shown.code == 0
    assert f"rsgen {command}" in shown.out.split("Example")[1]
    assert ("--json" in shown.out) == (command not in ("derive", "laws"))


@pytest.mark.slow
def test_check_says_what_a_run_will_do(run_cli):
    lines = run_cli("check", ROOT / "cases").out.splitlines()
    assert len(lines) == len(list((ROOT / "cases").glob("*.toml")))
    assert "12 levels x 121 frequencies = 1452 points" in lines[0]
    answer = json.loads(run_cli("check", ROOT / "cases" / "cubic.toml", "--json").out)
    (case,), names = answer["cases"], ["c1", "k1", "kn1"]
    assert (answer["faults"], case["parameters"], case["identifies"]) == ([], names, ["m", *names])


@pytest.mark.slow
@pytest.mark.parametrize("law", ["k*x + mu*sign(v) + c*v", "k*x + masing(Min(kt*x, Fs))"])
def test_init_writes_a_case_that_is_right(law, tmp_path, run_cli):
    path = tmp_path / "gearbox.v1.5.toml"
    assert run_cli("init", path, "--law", law).code == 0
    assert run_cli("check", path).code == 0
    again = run_cli("init", "gearbox.v1.5", "--out", path)
    assert (again.code, "is there already" in again.err) == (2, True)
    assert run_cli("init", "gearbox.v1.5", "--law", law, "--out", path, "--force").code == 0
    assert law.split("*")[0] in path.read_text()


@pytest.mark.slow
def test_run_tells_accepted_from_missed(tmp_path, run_cli):
    path, out = write_small(tmp_path, "a", accept={"k": 1e-2}), tmp_path / "out"
    for more, unchanged in (((), False), ((), True), (("--figures", "svg"), False)):
        run = run_cli("run", path, "--out", out, *more)
        assert (run.code, "unchanged" in run.out) == (0, unchanged)
    assert len(list(out.glob("a/figure-*.svg"))) >= 5
    (told,) = json.loads(run_cli("run", path, "--out", out, "--json", "--figures", "svg").out)
    assert (told["passed"], told["skipped"]) == (True, True)
    assert len(json.loads(run_cli("diff", out / "a", out / "a", "--json").out)["fits"]) == 2
    # no method is that good
    run = run_cli("run", write_small(tmp_path, "a", accept={"k": 1e-300}), "--out", out)
    assert (run.code, "a: Missed: k outside tolerance" in run.out) == (1, True)


def on_terminal(*words: str | Path, **environment: str) -> str:
    pty = pytest.importorskip("pty", reason="pseudo-terminals are POSIX")

    ours, theirs = pty.openpty()
    around = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", **environment}
    process = subprocess.Popen([*RSGEN, *words], stdout=theirs, stderr=theirs, env=around)
    os.close(theirs)
    shown = b""
    with suppress(OSError):  # how a pseudo-terminal ends
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    assert process.wait(60) == 0
    return shown.decode("utf-8")


@pytest.mark.thorough
def test_a_terminal_sees_how_far_each_case_is_and_the_same_input_gives_the_same_bytes(tmp_path):
    cases = [write_small(tmp_path, name, accept={"k": 1e-2}) for name in ("a", "b")]
    outs = [tmp_path / "one", tmp_path / "two"]
    # in another process: an order that hashes decide would differ
    for jobs, (out, colours) in enumerate(zip(outs, ({"NO_COLOR": "1"}, {}), strict=True), start=1):
        shown = on_terminal("run", *cases, "--jobs", str(jobs), "--out", out, **colours)
        assert "Traceback" not in shown
        # a line is drawn a few times a second: the quick stages of a small case may pass between two pictures
        for words in ("cases", "0 of 2", "a: ", "b: ", "0:00:0", "Accepted"):
            assert words in shown
        assert ("writing the report" in shown) is (jobs == 1)
        assert bool(re.search(r"\x1b\[(?:3[0-9]|38;)", shown)) is (jobs == 2)
        # and nothing of it gets into the output of a cell
        for name in ("a", "b"):
            cells = json.loads((out / name / "notebook.ipynb").read_text())["cells"]
            outputs = [output for cell in cells for output in cell.get("outputs", [])]
            assert {output.get("name", "stdout") for output in outputs} == {"stdout"}
    for name in ("index.html", "a/kernel.py", "a/surface.h5", "a/notebook.ipynb"):
        first, second = ((out / name).read_bytes() for out in outs)
        assert first == second, name
    # what is left may differ in the times alone
    times = re.compile(r"<dt>(?:Written|Durations)</dt><dd>[^<]*</dd>|\"seconds\": [0-9.e-]+")
    for name, count in (("a/report.html", 2), ("a/result.json", 1)):
        first, second = (times.subn("", (out / name).read_text(encoding="utf-8")) for out in outs)
        assert first == second, name
        assert first[1] == count


@posix
@pytest.mark.slow
def test_an_interrupt_ends_with_130_and_leaves_nothing(tmp_path):
    cases = [write_small(tmp_path, name) for name in ("a", "b")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    words = ["run", *cases, "--jobs", "2", "--out", tmp_path / "out"]
    process = subprocess.Popen([*RSGEN, *words], **pipes)
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("out/.*.part")) and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, "Traceback" in errors, "interrupted" in errors) == (130, False, True)
    # what had been finished by then is whole
    left = list((tmp_path / "out").glob("*"))
    assert [path for path in left if read_manifest(path) is None] == []
    assert len(left) < 2


SOUND = "frequency [Hz],F [N],x [m],phase [deg]\n9,1,2e-3,10\n10,1,4e-3,90\n11,1,1e-3,170\n"
HEAVY = "matplotlib numba scipy.linalg scipy.optimize scipy.stats h5py pint concurrent.futures.process"


@pytest.mark.slow
@pytest.mark.parametrize(("command", "unneeded"), [
    ("derive k*x", ""), ("laws", ""), ("check cubic.toml", "numpy.ma"), ("inspect a.csv", "sympy jinja2"),
    ("inspect steps.h5", "sympy jinja2"),
])  # fmt: skip
def test_short_commands_load_neither_figures_nor_compiler(command, unneeded, tmp_path):
    tmp_path.joinpath("a.csv").write_text(SOUND)
    for file in ("cubic.toml", "formats/steps.h5"):
        shutil.copy(ROOT / "cases" / file, tmp_path)
    code = (
        "import sys\nfrom rsgen.app.cli import main\n"
        "try:\n    main(sys.argv[2:])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "print([name for name in sys.argv[1].split() if name in sys.modules])"
    )
    done = python("-c", code, f"{HEAVY} {unneeded}", *command.split(), check=True, cwd=tmp_path)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_wildcard_in_quotes_stands_for_its_files_and_an_open_todo_is_said(tmp_path, run_cli):
    for file in (ROOT / "cases" / "formats").glob("magnitude_*.csv"):
        shutil.copy(file, tmp_path)
    path = tmp_path / "runs.toml"
    assert run_cli("init", "--from", tmp_path / "magnitude_*.csv", path).code == 0
    text = path.read_text()
    assert 'file = ["magnitude_1.0N.csv", "magnitude_3.0N.csv", "magnitude_6.0N.csv"]' in text
    line = next(n for n, line in enumerate(text.split("\n"), start=1) if "TODO" in line)
    path.write_text(text.replace('"? ', '"1 '))
    said = f"doubt: not confirmed: unit of test.response (line {line})"
    assert said in run_cli("check", path).out
    ended = run_cli("identify", path)
    assert (ended.code, "not confirmed" in ended.out.lower()) == (1, True)
    assert "not confirmed" not in run_cli("check", ROOT / "cases" / "formats" / "csv-magnitude.toml").out
    refused = run_cli("init", "clamp", "--from", tmp_path / "*.tdms")
    assert (refused.code, "a case lists several: file = [...]" in refused.err) == (2, True)


def test_examples_are_the_cases_of_the_repository_and_what_is_there_and_differs_stays(run_cli, tmp_path):
    told = run_cli("examples", tmp_path, "--json")
    assert told.code == 0
    written = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    assert sorted(json.loads(told.out)["files"]) == [str(path) for path in written]
    assert {path.relative_to(tmp_path).as_posix() for path in written} == files_of("cases")
    for path in written:
        assert path.read_bytes() == (ROOT / path.relative_to(tmp_path)).read_bytes()
    changed, missing = tmp_path / "cases" / "cubic.toml", tmp_path / "cases" / "bilinear.toml"
    changed.write_text("mine")
    missing.unlink()
    told = run_cli("examples", tmp_path)
    assert (told.code, told.err.startswith(f"{changed}: is there and differs")) == (2, True)
    assert (changed.read_text(), missing.exists()) == ("mine", False)
    changed.unlink()
    assert run_cli("examples", tmp_path).code == 0
    assert missing.exists()
