"""Force laws: elements, their normal form, their numbers, and the library."""

from rsgen.law.element import Element, Law, LawLike, as_elements, make_element
from rsgen.law.library import laws

__all__ = ["Element", "Law", "LawLike", "as_elements", "laws", "make_element"]
