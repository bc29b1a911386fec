"""The public names of rsgen, which tests/pins/names.json lists, and the types of what is declared."""

import ast
import importlib
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_origin

import numpy as np
import pytest
from typing_extensions import TypeAliasType

import rsgen
from rsgen.common.declaration import Rule, read_hint
from tests.programs import python


def test_the_public_names_are_listed_and_an_unknown_one_is_answered_with_them():
    assert dir(rsgen) == sorted([*rsgen.__all__, "__version__"])
    with pytest.raises(AttributeError, match="identify, laws"):
        _ = rsgen.identfy


def test_importing_rsgen_loads_no_numerics():
    code = "import rsgen, sys; print([m for m in ('numpy', 'sympy', 'matplotlib') if m in sys.modules])"
    assert python("-c", code).stdout.strip() == "[]"


def test_a_type_checker_sees_each_name_where_it_is_taken_from():
    tree = ast.parse(Path(rsgen.__file__).read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name: line.module for line in block.body for alias in line.names}
    assert sorted(seen) == sorted(rsgen.__all__)
    for name, module in seen.items():
        place = importlib.import_module(f"rsgen.{name}" if module == "rsgen" else module)
        assert (place if module == "rsgen" else getattr(place, name)) is getattr(rsgen, name)


Scalar = TypeVar("Scalar", bound=np.generic)
Named = TypeAliasType("Named", np.ndarray[tuple[Any, ...], np.dtype[Scalar]], type_params=(Scalar,))


def test_an_array_is_an_array_where_its_type_is_an_alias_with_a_name():
    # NumPy 2.5 declares NDArray in this way
    base, rule, optional = read_hint(Annotated[Named[np.float64] | None, Rule("levels", unit="N")])
    assert get_origin(base) is np.ndarray
    assert (rule.unit, optional) == ("N", True)
    # of several types none is left out
    assert read_hint(int | str | None)[::2] == (int | str, True)
