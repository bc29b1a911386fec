"""What a user types wrongly is said with the words that were typed, what is allowed, and what is near."""

from pathlib import Path

import numpy as np
import pytest

from tests.case_files import MEASURED, SMALL, changed
from tests.measurement.tables import write_columns

TABLE = {
    "test.frequency": {"column": "f"}, "test.force": {"amplitude": "F"},
    "test.response": {"quantity": "displacement", "real": "a", "imaginary": "b", "phase_sense": "lead"},
}  # fmt: skip


@pytest.fixture
def laboratory(tmp_path, monkeypatch):
    """A folder to work in, with a case that reads a table of 2 levels by 21 frequencies."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RSGEN_DATA", raising=False)
    folder = Path("lab")
    folder.mkdir()
    (folder / "small.toml").write_text(changed(SMALL, {}), encoding="utf-8")
    (folder / "read.toml").write_text(changed(SMALL, MEASURED | TABLE | {"name": "read"}), encoding="utf-8")
    write_table(folder / "a.csv")
    return folder


def write_table(path: Path, head: str = "f,F,a,b", far: float | None = None) -> None:
    """Write the table, with a response that is ``far`` above all others."""
    level, frequency = np.repeat([1.0, 2.0], 21), np.tile(np.linspace(8, 12, 21), 2)
    omega = 2 * np.pi * frequency
    response = level / (5920 - 1.5 * omega**2 + 8j * omega)
    response[5] = far or response[5]
    write_columns(path, head, frequency, level, response.real, response.imag)


@pytest.mark.parametrize(("words", "said"), [
    ("check lab/smal.toml", "lab/smal.toml: does not exist; ... did you mean 'lab/small.toml'?"),
    ("identify lab/a.csv", "lab/a.csv: line 1, column 2: ... `rsgen init --from` writes"),
    ("identify lab", "lab: is no regular file"),
    ("check lab/read.toml --data absent", "lab/read.toml: test.file: ... absent/a.csv: cannot be read"),
    ("inspect lab/a.cs", "lab/a.cs: cannot be read: ... did you mean 'lab/a.csv'?"),
    ("inspect lab/small.toml", "lab/small.toml: is a case file, which `rsgen check` reads"),
    ("laws cubic", "law 'cubic': unknown; did you mean 'cubic-spring' or 'softening-hardening-spring'?"),
    ("derive cubic-spring", "cubic-spring is a law of the library ... write k*x + k3*x**3"),
    ("derive k*x+k2*sing(x)", "column 8: 'sing' is not a function of formulas, did you mean 'sin'?"),
    ("init", "NAME: is missing"),
    ("init index.html", "name: 'index.html' is not a plain name ... as in 'index-html'"),
    ("derive", "rsgen derive: Missing argument 'expression'. See: rsgen derive --help"),
    ("run --frce x", "rsgen run: No such option: --frce (Possible ... --force) See: rsgen run --help"),
    ("rnu", "rsgen: No such command 'rnu'. Did you mean 'run'?"),
    ("run lab/small.toml --figures PDF", "--figures PDF: must be one of pdf, svg, png"),
    ("diff lab absent", "lab: holds no result of rsgen"),
])  # fmt: skip
@pytest.mark.usefixtures("laboratory")
def test_wrong_words_are_said_as_typed(words, said, run_cli):
    refused = run_cli(*words.split())
    assert (refused.code, refused.out, refused.err.count("\n")) == (2, "", 1)
    start, *rest = said.split(" ... ")
    typed = refused.err.replace("\\\\", "/").replace("\\", "/")
    assert typed.startswith(start)
    assert all(part in typed for part in rest)


def test_a_link_out_of_the_folder_is_called_a_link(laboratory, run_cli):
    write_table(Path("outside.csv"))
    (laboratory / "a.csv").unlink()
    (laboratory / "a.csv").symlink_to(Path("..", "outside.csv"))
    said = "lab/read.toml: test.file: 'a.csv' is a link out of its folder; copy the file into it\n"
    assert run_cli("check", laboratory / "read.toml").err == said


@pytest.mark.parametrize(("changes", "said"), [
    ({"test.response.real": "aa"}, "a.csv: line 1: no column named 'aa'; did you mean 'a'? known: 'f'"),
    ({"test.force.factor": "10 N/V"}, "test.force.factor: '10 N/V' leads from numbers in N to no N; unit"),
    ({"identify": {"hold_out": [7]}}, "hold_out: no level 7 N in the test; it has 1, 2 N"),
])  # fmt: skip
def test_what_a_measured_case_says_wrongly_is_named_by_its_key(laboratory, run_cli, changes, said):
    path = laboratory / "read.toml"
    path.write_text(changed(SMALL, MEASURED | TABLE | changes), encoding="utf-8")
    refused = run_cli("check", path)
    assert (refused.code, refused.err.count("\n"), said in refused.err) == (2, 1, True)
    assert refused.err.startswith(f"{path}: ")


def test_one_response_far_above_all_others_is_said_to_be_an_outlier(laboratory, run_cli):
    write_table(laboratory / "a.csv", far=1e20)
    said = run_cli("check", laboratory / "read.toml").err
    assert "41 move less than 1e-12 of the largest response, 1e+20 m" in said
    assert said.endswith("or the largest is an outlier)\n")


def test_a_draft_of_files_elsewhere_says_the_folder_and_the_command(laboratory, run_cli):
    Path("here").mkdir()
    for names, folder in ((["a"], "lab"), (["a", "more/b"], Path("lab").resolve())):
        for name in names:
            Path("lab", name).parent.mkdir(exist_ok=True)
            write_table(Path("lab", f"{name}.csv"), head="frequency,force,x_re,x_im")
        case = Path("here", f"{names[-1][-1]}.toml")
        files = [part for name in names for part in ("--from", Path("lab", f"{name}.csv"))]
        said = run_cli("init", case, *files).out
        assert f"`rsgen check {case} --data {folder}`" in said
        assert f"in {folder}: set RSGEN_DATA" in case.read_text("utf-8")
        assert "does not exist" not in run_cli("check", case, "--data", folder).err


def test_a_name_of_a_file_that_is_none_of_a_case_is_made_one(laboratory, run_cli):
    write_table(Path("A=0.09.csv"), head="frequency,force,x_re,x_im")
    assert run_cli("init", "--from", "A=0.09.csv").code == 0
    assert '"A-0.09"' in Path("A-0.09.toml").read_text(encoding="utf-8")
