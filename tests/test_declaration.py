"""Declared types are read alike, however the libraries of this machine write them."""

from typing import Annotated, Any, TypeVar, get_origin

import numpy as np
from typing_extensions import TypeAliasType

from rsgen.common.declaration import Rule, read_hint

Scalar = TypeVar("Scalar", bound=np.generic)
Named = TypeAliasType("Named", np.ndarray[tuple[Any, ...], np.dtype[Scalar]], type_params=(Scalar,))


def test_an_array_is_an_array_where_its_type_is_an_alias_with_a_name():
    # NumPy 2.5 declares NDArray in this way
    base, rule, optional = read_hint(Annotated[Named[np.float64] | None, Rule("levels", unit="N")])
    assert get_origin(base) is np.ndarray
    assert (rule.unit, optional) == ("N", True)


def test_of_several_types_none_is_left_out():
    base, _, optional = read_hint(int | str | None)
    assert base == int | str
    assert optional
