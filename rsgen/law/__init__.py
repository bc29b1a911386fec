"""Force laws: elements, their normal form, their numbers, and the library."""
