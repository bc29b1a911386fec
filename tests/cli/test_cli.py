"""The command line: answers on standard output, one sentence a fault on standard error, honest exit codes."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from rsgen import __version__
from rsgen.app.cli import main
from rsgen.app.cli.application import COMMANDS
from rsgen.app.study import read_manifest
from rsgen.common.process import ALGEBRA
from rsgen.formula import parse
from tests.case.faults import FAULTS, Fault

ROOT = Path(__file__).parents[2]
PROGRAM = [sys.executable, "-c", "from rsgen.app.cli import main; main()"]
HELP_SECONDS = 1.0
"""Of the processor: the promise is 0.3 s on a quiet machine; a busy one gets air."""


def call(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(word) for word in words])
    assert isinstance(caught.value.code, int)
    return caught.value.code


def shell(*words: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.fixture(autouse=True)
def _keep_signals() -> object:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def test_help_is_quick_and_teaches() -> None:
    before = os.times()
    run = shell("--help")
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    assert spent < HELP_SECONDS
    assert run.returncode == 0
    assert run.stderr == ""
    for command in COMMANDS:
        assert re.search(rf"^  {command} ", run.stdout, re.MULTILINE)
    assert "rsgen init gearbox" in run.stdout


def test_linear_algebra_stays_in_one_thread_unless_the_user_says_more() -> None:
    show = "import atexit, os, sys; from rsgen.app.cli import main; before = 'numpy' in sys.modules; " + (
        "atexit.register(lambda: print(before, *map(os.environ.get, sys.argv[1:]))); main(['--version'])"
    )
    others = {name: value for name, value in os.environ.items() if name not in ALGEBRA}
    run = subprocess.run(
        [sys.executable, "-c", show, *ALGEBRA],
        capture_output=True,
        text=True,
        check=True,
        env=others | {"MKL_NUM_THREADS": "3"},
    )
    assert run.stdout.splitlines()[-1] == "False 1 1 3"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(command, "--help") == 0
    text = capsys.readouterr().out
    assert f"rsgen {command}" in text.split("Example")[1]
    # a program may listen to each
    assert "--json" in text


@pytest.mark.slow
def test_the_shell_completes_commands_and_options() -> None:
    for words, number, expected in (("rsgen de", 1, "derive"), ("rsgen run --job", 2, "--jobs")):
        completed = shell(_RSGEN_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(number))
        assert completed.stdout.split() == [expected]


@pytest.mark.slow
def test_python_runs_it_as_a_module() -> None:
    words = [sys.executable, "-m", "rsgen"]
    run = subprocess.run([*words, "--version"], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, f"rsgen {__version__}\n", "")
    refused = subprocess.run([*words, "rnu"], capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "No such command 'rnu'" in refused.stderr


def test_no_words_show_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert call() == 0
    assert "Usage: rsgen" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("rnu",), "No such command 'rnu'"),
        (("run",), "Missing argument"),
        (("run", "--frce", "x"), "No such option"),
        (("run", "x.toml", "--jobs", "0"), "jobs"),
        (("run", "absent.toml"), "absent.toml': does not exist"),
        (("derive", "k*x +"), ""),
        (("derive", "__import__('os')"), ""),
        (("init", "../x"), "is not a plain name"),
        (("report", "--out", "absent"), "no folder of results"),
        (("simulate", "absent.toml"), "absent.toml"),
        (("run", ROOT / "cases" / "cubc.toml"), "cubic.toml'?"),
        (("run", ROOT / "cases", "--figures", "tiff"), "must be one of pdf, svg, png"),
        (("report", "--figures", "pdf"), "name them"),
        (("diff", "absent", "absent"), "holds no result"),
    ],
)
def test_faulty_words_get_a_sentence(
    words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(*words) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    assert message in caught.err
    assert caught.err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_faulty_case_ends_with_2_and_no_traceback(
    fault: Fault, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = fault.write(tmp_path)
    for command in (("check",), ("run", "--out", tmp_path / "out")):
        assert call(*command, path) == 2
        caught = capsys.readouterr()
        assert caught.out == ""
        assert "Traceback" not in caught.err
        assert all(line.startswith(f"{path.name}: ") for line in caught.err.splitlines())
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_check_says_what_a_run_will_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("check", ROOT / "cases") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(list((ROOT / "cases").glob("*.toml")))
    assert "12 levels x 121 frequencies = 1452 points" in lines[0]
    assert call("check", ROOT / "cases" / "cubic.toml", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["faults"] == []
    assert answer["cases"][0]["parameters"] == ["c1", "k1", "kn1"]
    assert answer["cases"][0]["identifies"] == ["m", "c1", "k1", "kn1"]


ODD = {
    "k*gamma(x)": "gamma has no place in a force law",
    "k*besselj(0, x)": "besselj has no place in a force law",
    "k*log(x)": "k*log(x) is infinite at rest",
    "k*log(abs(x))": "is infinite at rest",
    "k/x": "k/x is infinite at rest",
    "k*v**(-1)": "is infinite at rest",
    "k*sqrt(x - 1)": "is not a number at x = 1e-12 m",
    "k*x**(-3)": "so singular at zero that the force has no fundamental",
}


@pytest.mark.slow
@pytest.mark.parametrize("law", [*ODD, "k*x*log(1 + abs(x))", "k*tan(x)", "k*x*abs(x)**0.5"])
def test_check_refuses_what_run_would_refuse(
    law: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "small.toml"
    path.write_text((SMALL % "1e-2").replace('"k*x + c*v"', f'"c*v + {law}"'))
    words = (("check", path), ("run", path, "--out", tmp_path / "out"))
    if law not in ODD:
        assert call(*words[0]) == 0
        return
    for command in words:
        assert call(*command) == 2
        message = capsys.readouterr().err
        assert message.startswith("small.toml: element.1.force: ")
        assert ODD[law] in message
        assert message.count("\n") == 1


COLOUR = re.compile(r"\x1b\[(?:3[0-9]|38;)")


@dataclass(frozen=True)
class Watched:
    """Where the cases a and b were run, by how many processes, and what a terminal showed of it."""

    cases: Path
    out: Path
    jobs: int
    shown: str


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Watched, Watched]:
    """Two cases run by one process, without colours, and by two, with them."""
    if os.name != "posix":
        pytest.skip("pseudo-terminals are POSIX")
    folder = tmp_path_factory.mktemp("watched")
    cases = folder / "cases"
    cases.mkdir()
    for name in ("a", "b"):
        (cases / f"{name}.toml").write_text((SMALL % "1e-2").replace('"small"', f'"{name}"'))
    found = []
    for jobs, colours in ((1, {"NO_COLOR": "1"}), (2, {})):
        out = folder / f"out{jobs}"
        shown = on_terminal("run", cases, "--jobs", str(jobs), "--out", out, **colours)
        found.append(Watched(cases, out, jobs, shown))
    return found[0], found[1]


def on_terminal(*words: str | Path, **environment: str) -> str:
    """What a terminal shows of a command that succeeds."""
    import pty

    ours, theirs = pty.openpty()
    around = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", **environment}
    process = subprocess.Popen([*PROGRAM, *words], stdout=theirs, stderr=theirs, env=around)
    os.close(theirs)
    shown = b""
    with suppress(OSError):  # how a pseudo-terminal ends
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    assert process.wait(60) == 0
    return shown.decode("utf-8")


@pytest.mark.thorough
def test_a_terminal_sees_how_far_each_case_is(watched: tuple[Watched, Watched]) -> None:
    for run in watched:
        assert "Traceback" not in run.shown
        # a line is drawn a few times a second: the quick stages of a small case may pass between two pictures
        for words in ("cases", "0 of 2", "a: ", "b: ", "writing the report", "0:00:0", "Accepted"):
            assert words in run.shown
        assert bool(COLOUR.search(run.shown)) is (run.jobs == 2)
        # and nothing of it gets into the output of a cell
        for name in ("a", "b"):
            cells = json.loads((run.out / name / "notebook.ipynb").read_text())["cells"]
            outputs = [output for cell in cells for output in cell.get("outputs", [])]
            assert outputs
            assert {output.get("name", "stdout") for output in outputs} == {"stdout"}


@pytest.mark.thorough
def test_the_same_input_gives_the_same_bytes(watched: tuple[Watched, Watched]) -> None:
    # in another process: an order that hashes decide would differ
    outs = [run.out for run in watched]
    for name in ("table1.md", "index.html", "a/kernel.py", "a/surface.h5", "a/notebook.ipynb"):
        first, second = ((out / name).read_bytes() for out in outs)
        assert first == second, name
    # what is left may differ in the times alone
    times = re.compile(r"<dt>(?:Written|Durations)</dt><dd>[^<]*</dd>|\"seconds\": [0-9.e-]+")
    for name, count in (("a/report.html", 2), ("a/result.json", 1)):
        first, second = (times.subn("", (out / name).read_text(encoding="utf-8")) for out in outs)
        assert first == second, name
        assert first[1] == count


def test_derive_as_json_parses_back(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("derive", "k1*x + kn1*x**3 + c2*v*abs(v)", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer) == {
        "force", "stiffness", "damping", "mean_balance", "mean", "closed_form", "checked_to", "parameters",
        "seconds",
    }  # fmt: skip
    # Liu et al., Eqs. (14) and (23)
    assert (parse(answer["stiffness"]) - parse("k1 + 3/4*kn1*X**2")).equals(0)
    assert (parse(answer["damping"]) - parse("8*c2*omega*X/(3*pi)")).equals(0)
    assert answer["closed_form"] is True
    assert answer["parameters"] == ["c2", "k1", "kn1"]


def test_derive_reads_as_a_person_writes(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("derive", "k1*x + kn1*x**3") == 0
    assert "k1 + 3/4 kn1 X^2" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", ["k1*x + kn1*x**3 + c1*v", "k*x + mu*sign(v) + c*v", "k*x + masing(Min(kt*x, Fs))"]
)
def test_init_writes_a_case_that_is_right(
    law: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "gearbox.toml"
    assert call("init", "gearbox", "--law", law, "--out", path) == 0
    assert call("check", path) == 0
    assert call("init", "gearbox", "--out", path) == 2
    assert "is there already" in capsys.readouterr().err
    assert law.split("*")[0] in path.read_text()


def test_init_refuses_a_law_that_never_settles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "gearbox.toml"
    assert call("init", "gearbox", "--law", "k*x", "--out", path) == 2
    assert "add a damper" in capsys.readouterr().err
    assert not path.exists()
    assert call("init", "gearbox", "--law", "k*x", "--measured", "mine.csv", "--out", path) == 0


def test_init_takes_a_file_for_a_name(tmp_path: Path) -> None:
    path = tmp_path / "my-joint.toml"
    assert call("init", path) == 0
    assert 'name   = "my-joint"' in path.read_text()
    assert call("check", path) == 0


def test_init_needs_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init") == 2
    assert "NAME: is missing" in capsys.readouterr().err


def test_init_of_a_measured_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    assert call("init", "mine", "--measured", "mine.csv", "--out", path) == 0
    assert call("check", path) == 2
    assert "mine.csv" in capsys.readouterr().err
    rows = [f"{f},{1.0},{2.0},{20 * f - 80}" for f in (7, 8, 9, 10)]
    (tmp_path / "mine.csv").write_text("\n".join(["f,F,a,phase", *rows]) + "\n")
    assert call("check", path) == 0
    assert "4 measured points at 1 level" in capsys.readouterr().out
    assert call("init", "mine", "--measured", "../mine.csv", "--out", tmp_path / "x.toml") == 2


SMALL = """\
schema = 1
name = "small"
title = "Small"
system = { mass = 1.5 }
element = [{ name = "spring", force = "k*x + c*v" }]
truth = { k = 5920.0, c = 8.0 }
accept = { k = %s }

[test]
kind = "simulated"
level = { values = [1, 2] }
frequency = { start = 8, stop = 12, count = 21 }
"""


@pytest.mark.slow
def test_simulate_then_identify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "small.toml").write_text(SMALL % "1e-3")
    assert call("simulate", tmp_path / "small.toml", "--out", tmp_path / "s.h5", "--json") == 0
    assert json.loads(capsys.readouterr().out)["points"] == 42
    assert call("identify", tmp_path / "small.toml", "--surface", tmp_path / "s.h5", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    found = {row["name"]: row["refined"]["value"] for row in answer["parameters"]}
    assert found["k"] == pytest.approx(5920.0, rel=1e-3)
    assert found["m"] == pytest.approx(1.5, rel=1e-3)
    assert call("identify", tmp_path / "small.toml", "--surface", tmp_path / "s.h5") == 0
    title, *rows = (re.split(r" {2,}", line.strip()) for line in capsys.readouterr().out.splitlines()[1:])
    assert "± (95 %)" in title
    printed = {row[0]: row for row in rows}
    for row in answer["parameters"]:
        low, high = row["refined"]["interval"]
        # the page prints the same half width
        assert float(printed[row["name"]][4]) == pytest.approx((high - low) / 2, rel=0.05)
        assert high - low > 2.1 * row["refined"]["standard_error"]


@pytest.mark.slow
def test_run_tells_accepted_from_missed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "a.toml", tmp_path / "out"
    case = SMALL.replace('"small"', '"a"')
    path.write_text(case % "1e-2")
    assert call("run", path, "--out", out) == 0
    assert "unchanged" not in capsys.readouterr().out
    assert call("run", path, "--out", out) == 0
    assert "unchanged" in capsys.readouterr().out
    assert call("run", path, "--out", out, "--json") == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert (told["passed"], told["skipped"]) == (True, True)
    assert call("run", path, "--out", out, "--figures", "svg") == 0
    assert "unchanged" not in capsys.readouterr().out
    assert len(list(out.glob("a/figure-*.svg"))) >= 8
    assert call("diff", out / "a", out, "--json") == 0
    assert json.loads(capsys.readouterr().out)[0]["changed"] is False
    # no method is that good
    path.write_text(case % "1e-300")
    assert call("run", path, "--out", out) == 1
    assert "a: Missed: k outside tolerance" in capsys.readouterr().out


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "begun", "jobs"),
    [
        # each signal, stage and number of workers
        (signal.SIGINT, "out/.*.part", "2"),
        # the page is written, the cells of the notebook run
        pytest.param(signal.SIGTERM, "out/.*.part/report.html", "1", marks=pytest.mark.thorough),
    ],
)
def test_an_interrupt_ends_with_130_and_leaves_nothing(
    tmp_path: Path, number: signal.Signals, begun: str, jobs: str
) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text((SMALL % "1e-2").replace('"small"', f'"{name}"'))
    process = subprocess.Popen(
        [*PROGRAM, "run", tmp_path, "--jobs", jobs, "--out", tmp_path / "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob(begun)) and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "interrupted" in errors
    # what had been finished by then is whole
    left = list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else []
    assert [path for path in left if read_manifest(path) is None] == []
    assert len(left) < 2


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="without owners of files there is no cache")
def test_a_cache_that_others_can_write_is_named_once_and_not_used(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL % "1e-2")
    cache = tmp_path / "cache"
    cache.mkdir()
    cache.chmod(0o777)
    run = shell("simulate", tmp_path / "small.toml", "--out", tmp_path / "surface.h5", RSGEN_CACHE=str(cache))
    assert run.returncode == 0
    assert run.stderr.count("compiled kernels are not stored") == 1
    assert list(cache.iterdir()) == []


_LOST = """
import os, signal, time
import rsgen.app.cli
from rsgen.app.cli import application

class Interrupts:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)

def run(**arguments):
    Interrupts()
    time.sleep(20)

application.application = run
rsgen.app.cli.main()
"""


_IMPORT = """
import contextlib, os, signal, sys, time
import rsgen.app.cli
from rsgen.app.cli import application

class Compiled:
    def find_spec(self, *_):
        sys.meta_path.remove(self)
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)
        except KeyboardInterrupt:
            raise ImportError("failed to load")

def run(**arguments):
    sys.meta_path.insert(0, Compiled())
    with contextlib.suppress(ModuleNotFoundError):
        import absent
    time.sleep(20)

application.application = run
rsgen.app.cli.main()
"""


_LATE = """
import os, signal
import rsgen.app.cli
from rsgen.app.cli import application

class Ends:
    def __del__(self, kill=os.kill, process=os.getpid(), number=signal.SIGTERM):
        kill(process, number)

# goes when Python takes its modules apart
ends = Ends()

def run(**arguments):
    os.kill(os.getpid(), signal.SIGINT)

application.application = run
rsgen.app.cli.main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")
@pytest.mark.parametrize(
    "program",
    [_LOST, _IMPORT, _LATE],
    ids=["in a finalizer", "in an import", "and a polite end at the exit"],
)
def test_an_interrupt_ends_the_run_with_one_sentence(program: str) -> None:
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stderr) == (130, "rsgen: interrupted; nothing half-written was left\n")


def test_packages_that_add_to_pydantic_are_not_looked_for(tmp_path: Path) -> None:
    tmp_path.joinpath("noisy.py").write_text("import sys\nsys.__stderr__.write('loaded')\nplugin = None\n")
    installed = tmp_path / "noisy-1.0.dist-info"
    installed.mkdir()
    installed.joinpath("METADATA").write_text("Metadata-Version: 2.1\nName: noisy\nVersion: 1.0\n")
    installed.joinpath("entry_points.txt").write_text("[pydantic]\nnoisy = noisy:plugin\n")
    surroundings = {key: value for key, value in os.environ.items() if key != "PYDANTIC_DISABLE_PLUGINS"}
    done = subprocess.run(
        [sys.executable, "-m", "rsgen", "check", str(ROOT / "cases" / "cubic.toml")],
        capture_output=True, text=True, timeout=120, cwd=ROOT,
        env=surroundings | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


_SOUND = """frequency [Hz],F [N],x [m],phase [deg]
9,1,2e-3,10
10,1,4e-3,90
11,1,1e-3,170
"""
_HEAVY = (
    "matplotlib", "numba", "scipy.linalg", "scipy.optimize", "scipy.stats", "h5py", "pint",
    "concurrent.futures.process",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "unneeded"),
    [
        (["derive", "k*x"], _HEAVY),
        (["laws"], _HEAVY),
        (["check", "cubic.toml"], (*_HEAVY, "numpy.ma")),
        (["inspect", "a.csv"], (*_HEAVY, "sympy", "jinja2")),
        (["inspect", "steps.h5"], (*_HEAVY, "sympy", "jinja2")),
    ],
)
def test_short_commands_load_neither_figures_nor_compiler(
    words: list[str], unneeded: tuple[str, ...], tmp_path: Path
) -> None:
    tmp_path.joinpath("a.csv").write_text(_SOUND)
    for file in ("cubic.toml", "formats/table.csv", "formats/steps.h5"):
        shutil.copy(ROOT / "cases" / file, tmp_path)
    code = (
        "import sys\nfrom rsgen.app.cli import main\n"
        "try:\n    main(sys.argv[2:])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "print([name for name in sys.argv[1].split() if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, " ".join(unneeded), *words],
        capture_output=True, text=True, timeout=120, check=True, cwd=tmp_path,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1] == "[]"
