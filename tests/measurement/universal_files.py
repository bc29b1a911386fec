"""Universal files as pyuff writes them; tests that use it are skipped where it is not there."""

import warnings

import numpy as np
import pytest

pyuff = pytest.importorskip("pyuff", reason="no pyuff here: install rsgen[test]")


def response_set(frequency: np.ndarray, data: np.ndarray, **keys) -> dict:
    """Return a frequency response (data set 58) of pyuff, accelerance over force unless ``keys`` differ."""
    known = {
        "func_type": 4, "rsp_node": 2, "rsp_dir": 3, "ref_node": 1, "ref_dir": 3, "rsp_ent_name": "BEAM",
        "ref_ent_name": "BEAM", "id1": "a", "binary": 0, "abscissa_spacing": 1, "z_axis_value": 0.0,
        "ordinate_spec_data_type": 12, "orddenom_spec_data_type": 13, "abscissa_spec_data_type": 18,
        "ord_data_type": 6, "num_pts": len(frequency), "abscissa_min": frequency[0],
        "abscissa_inc": frequency[1] - frequency[0],
    }  # fmt: skip
    return pyuff.prepare_58(data=data, x=frequency, **known | keys)


def write_sets(path, *sets: dict):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pyuff.UFF(str(path)).write_sets(list(sets), "overwrite")
    return path
