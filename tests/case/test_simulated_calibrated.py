"""A simulated test is calibrated."""

import pytest

import rsgen
from tests.case_files import write_small


def test_a_simulated_test_that_is_not_calibrated_is_refused_with_what_is_allowed(tmp_path):
    assert rsgen.load_case(write_small(tmp_path, changes={"identify.calibrated": True}))
    path = write_small(tmp_path, changes={"identify.calibrated": False})
    with pytest.raises(
        rsgen.RsgenError, match=r"identify\.calibrated: is false.*true alone is allowed"
    ) as told:
        rsgen.load_case(path)
    assert "system.mass" not in str(told.value)
