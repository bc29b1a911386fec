"""Cases on a Dask cluster: the same results as on this machine, and a sentence for what goes wrong."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rsgen.app.study import read_manifest, run_cases
from rsgen.common.errors import RsgenError
from tests.study.test_study import write_case

pytest.importorskip("distributed", reason="dask.distributed is an extra: rsgen[cluster]")

# a program of its own: a scheduler and its workers leave threads and sockets behind them
PROGRAM = """
import sys
from pathlib import Path

from distributed import LocalCluster

from rsgen.app.study import run_cases

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    settings = {"dashboard_address": None, "processes": True, "n_workers": 1, "threads_per_worker": 1}
    with LocalCluster(**settings) as cluster:
        seen = []
        runs = run_cases(
            [folder / "cases"], folder / "out", cluster=cluster.scheduler_address, finished=seen.append
        )
    assert sorted(run.name for run in seen) == ["broken", "one", "two"]
    for run in runs:
        print(run.name, run.passed, run.path.parent.name, run.folder and run.folder.parent.name, *run.faults)
"""


@pytest.mark.thorough
def test_a_cluster_leaves_the_same_results(tmp_path: Path) -> None:
    cases = tmp_path / "cases"
    cases.mkdir()
    for name in ("one", "two"):
        write_case(cases, name)
    (cases / "broken.toml").write_text("schema = 1\n")
    script = tmp_path / "study.py"
    script.write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path)], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    broken, one, two = done.stdout.splitlines()
    assert broken.startswith("broken None cases None broken.toml: ")
    assert (one, two) == ("one True cases out", "two True cases out")
    here = tmp_path / "here"
    run_cases([cases / "one.toml"], here, workers=1)
    for name in ("one", "two"):
        assert read_manifest(tmp_path / "out" / name) is not None
    for name in ("surface.h5", "kernel.py", "notebook.ipynb"):
        assert (tmp_path / "out" / "one" / name).read_bytes() == (here / "one" / name).read_bytes()
    assert (tmp_path / "out" / "index.html").is_file()


def test_no_scheduler_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_case(tmp_path)
    with pytest.raises(RsgenError, match=r"--cluster nonsense://here: no scheduler answers"):
        run_cases([path], tmp_path / "out", cluster="nonsense://here")
    # as where the extra is not installed
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RsgenError, match=r'pip install "rsgen\[cluster\]"'):
        run_cases([path], tmp_path / "out", cluster="tcp://127.0.0.1:1")
