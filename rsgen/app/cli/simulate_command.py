"""What `rsgen simulate` does: the response surface of a simulated case as a file."""

from __future__ import annotations

from pathlib import Path

from rsgen.app.cli.progress_bar import stage_progress
from rsgen.app.cli.targets import SURFACE, inputs_of, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import ACCEPTED, MISSED, print_cache_fault, print_json, print_line
from rsgen.app.study import obtain_surface
from rsgen.cases import load_case
from rsgen.cases.trial import law_faults
from rsgen.common.errors import CaseError, RsgenError
from rsgen.data.surface import save_surface
from rsgen.dynamics.simulation import MultisineTest
from rsgen.files import MeasuredTest

__all__ = ["simulate_command"]


def simulate_command(path: Path, out: Path | None, json: bool) -> int:
    """Write the response surface of a simulated case as HDF5."""
    print_cache_fault()
    case = load_case(path)
    if isinstance(case.test, MeasuredTest):
        raise RsgenError(f"{path.name}: test.kind: is 'measured'; only a simulated test can be simulated")
    if isinstance(case.test, MultisineTest):
        raise RsgenError(
            f"{path.name}: test.kind: a multisine has no response surface; `rsgen run` simulates it"
        )
    refused = law_faults(case)
    if refused:
        raise CaseError(refused)
    target = out or Path(f"{case.name}.h5")
    refuse_foreign(target, is_foreign(target, SURFACE), inputs_of(case))
    with stage_progress(case, "surface") as note:
        surface = obtain_surface(case, lambda share: note("surface", share))
    save_surface(target, surface)
    settled = int(surface.settled.sum())
    if json:
        print_json({"case": case.name, "file": str(target), "points": len(surface), "settled": settled})
    else:
        print_line(f"{case.name}: {len(surface)} points, {settled} settled: {target}")
        if not settled:
            print_line(
                "no point settled: check the values of [truth], their signs first; levels and frequencies"
            )
    return ACCEPTED if settled else MISSED
