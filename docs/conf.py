"""Sphinx builds the pages of this folder: `make docs`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import teg

project = "Teg"
author = "The Teg developers"
copyright = "2026, The Teg developers"
release = version = teg.__version__
extensions = ["myst_nb", "sphinx_copybutton", "docstring_pages", "formulas"]
exclude_patterns = ["**/README.md"]
root_doc = "index"
html_theme = "furo"
html_title = f"Teg {release}"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sphinx = False
copybutton_exclude = ".linenos, .gp, .go"
pygments_style = "friendly"
highlight_language = "text"
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
nitpicky = True
smartquotes = False
html_math_renderer = "mathml"
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_render_markdown_format = "myst"
nb_mime_priority_overrides = [("html", "text/markdown", 25)]  # an evaluator, with its formula
toc_object_entries_show_parents = "hide"
maximum_signature_line_length = 90
