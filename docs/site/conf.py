"""How Sphinx makes the site; `docs.site.build` gathers what it is made of."""

from __future__ import annotations

from mlscli.version import __version__

project = "mls"
author = "the authors of mls"
html_show_copyright = False
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "mls"
html_copy_source = False
myst_heading_anchors = 4
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
