"""Force laws: elements, their normal form, their numbers along a motion, and the library."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.law.element import Element, Law, LawLike, as_elements, laws, make_element
    from rsgen.law.loops import compile_loops

__all__ = ["Element", "Law", "LawLike", "as_elements", "compile_loops", "laws", "make_element"]

# motions are used without the library of algebra, most laws without loops
__getattr__ = on_first_use(
    __name__,
    dict.fromkeys(("Element", "Law", "LawLike", "as_elements", "laws", "make_element"), "element")
    | {"compile_loops": "loops"},
)
