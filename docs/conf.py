"""How the site is built from these pages: ``sphinx-build -W --keep-going -b html docs docs/_build/html``."""

import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "schuler"
author = "The schuler developers"
copyright = author
release = metadata.version("schuler")
extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "api_pages", "mathml", "notebook_pages", "repository",
]  # fmt: skip
exclude_patterns = ["_build"]
nitpicky = False  # array types and unions in docstrings are prose, not names to link

# Markdown as GitHub reads it: anchors of headings, dollars for equations
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]

# docstrings hold the types in words, with shapes and units
autodoc_typehints = "none"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_maximum_signature_line_length = 100
toc_object_entries = False  # thousands of them, copied into every page

# works from a file system: no fonts or scripts of others, no summaries that a search would have to fetch
html_theme = "furo"
html_title = f"schuler {release}"
html_math_renderer = "mathml"
html_show_search_summary = False
html_copy_source = False
html_use_index = False  # a megabyte of names; the search finds them
html_static_path = ["_static"]
html_css_files = ["site.css"]
