"""From case files to finished reports: one case, many cases, and what makes a result a result."""
