"""Force laws: elements, their normal form, their numbers along a motion, and the library."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.law.element import Element, Law, LawLike, as_elements, laws, make_element

__all__ = ["Element", "Law", "LawLike", "as_elements", "laws", "make_element"]

# motions are used without the library of algebra
__getattr__ = on_first_use(
    __name__,
    dict.fromkeys(("Element", "Law", "LawLike", "as_elements", "laws", "make_element"), "element"),
)
