"""How Sphinx builds these pages: `make docs`. Nothing is fetched, and a warning ends the build."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parent))
os.environ.setdefault("MPLBACKEND", "agg")

import rsgen  # noqa: E402 - the path is set above

project = "rsgen"
author = "the authors of rsgen"
project_copyright = author
version = release = rsgen.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "_extension"]
exclude_patterns = ["_build", "_extension"]
myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline", "colon_fence"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

nitpicky = True
# types that signatures name: other libraries have their own pages, inner types of rsgen have none
nitpick_ignore_regex = [("py:class|py:obj|py:data|py:exc", r".*")]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_attr_annotations = False
default_role = "code"
add_module_names = False

html_theme = "furo"
html_title = "rsgen"
html_static_path = ["_static"]
html_css_files = ["rsgen.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"
