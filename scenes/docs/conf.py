"""Settings with which Sphinx builds these pages: python -m sphinx -W scenes/docs build/docs."""

from typing import Any

import warpgrains
from warpgrains.base.described import FIELDS_IN_HELP

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


def setup(app: Any) -> None:
    """Leave out fields that `help()` shows, because autodoc shows them as members."""
    app.connect("autodoc-process-docstring", _end_before_fields)


def _end_before_fields(_app: Any, _what: str, _name: str, _own: Any, _options: Any, lines: list[str]) -> None:
    if FIELDS_IN_HELP in lines:
        del lines[lines.index(FIELDS_IN_HELP) :]
