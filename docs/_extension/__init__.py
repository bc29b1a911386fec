"""What these pages need beyond Sphinx: formulas without network, commands that run, and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, Any]:
    """Register all parts with Sphinx."""
    # the tests take the snippets from here where no Sphinx is installed
    from . import accessible, docstrings, execution, mathml

    # a test of links and pages needs neither the output of commands nor every picture
    app.add_config_value("rsgen_quick", False, "env", bool)
    for part in (accessible, docstrings, execution, mathml):
        part.register(app)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
