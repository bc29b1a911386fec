"""List the contents of a data file, and draft a case that reads it."""
