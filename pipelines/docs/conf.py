"""Settings of the documentation site (Sphinx): `python -m pipelines.docs` builds it.

The source folder is the repository's root, so that every page is read from where it is and its links stay as they are.
"""

from __future__ import annotations

import sys
from pathlib import Path

from sphinx.domains.python import PyObject

from mcstudy.report.style import COLOURS, DARK

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))  # pipelines.docs.* are extensions

project = "mcstudy"
author = "the mcstudy developers"
root_doc = "pipelines/docs/index"
include_patterns = [
    "README.md",
    "mcstudy/**.md",
    "pipelines/**.md",
    "results_schema/**.md",
]
exclude_patterns = ["build", ".venv"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "pipelines.docs.commands",
    "pipelines.docs.effects",
    "pipelines.docs.executed",
    "pipelines.docs.mathml",
    "pipelines.docs.names",
]
myst_enable_extensions = ["deflist", "dollarmath"]
smartquotes = False  # --option must stay what it is
myst_heading_anchors = 4
executed_pages = ["pipelines/docs/"]

default_role = "py:obj"  # a name in single backticks is a link where the reference has it
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
python_use_unqualified_type_names = True
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
next(f for f in PyObject.doc_field_types if f.name == "variable").label = "Attributes"
html_math_renderer = "mathml"

html_theme = "furo"
html_title = "mcstudy"
html_theme_options = {"light_css_variables": COLOURS, "dark_css_variables": DARK}  # figures use them
html_static_path = ["static"]
html_css_files = ["site.css"]
templates_path = ["templates"]
html_additional_pages = {"index": "entry.html"}
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
