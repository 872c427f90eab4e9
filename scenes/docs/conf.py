"""Settings with which Sphinx builds these pages: python -m sphinx -W scenes/docs build/docs."""

import warpgrains

project = "warpgrains"
version = release = warpgrains.__version__
extensions = ["myst_parser", "sphinxarg.ext", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"warpgrains {release}"
html_copy_source = False
default_role = "py:obj"
highlight_language = "none"
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings tell shapes and units, where they matter
