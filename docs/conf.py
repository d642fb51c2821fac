"""Configuration of the site: `sphinx-build -W -j auto docs build/site`, with the packages of the extra "docs".

The pages of this folder are Markdown. Each build writes four more folders, which are not under version control:
`tutorials` and `gallery` from the scripts, `api` from the docstrings, `studies` from the folder of that name.
"""

import logging
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_site"))

import mathml

import hbgear

logging.getLogger("pint.util").setLevel(logging.ERROR)  # warns of the redefinition of Nm

project, author, version = "hbgear", "hbgear developers", hbgear.__version__
release = version
copyright = "hbgear developers, MIT licence"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "sphinx_copybutton",
    "docstrings",  # numpydoc docstrings: prose of reStructuredText
    "mathml",  # equations without scripts and without a network
    "names",  # Python objects in the search
    "written",  # pages of the API, of the commands and of the studies
    "whole",  # check of links; no content from other sites
]
exclude_patterns = ["_site", "scripts", "README.md"]
suppress_warnings = ["config.cache", "ref.python"]  # `size` is an attribute of several classes
smartquotes = False  # "--harmonics" is two dashes
default_role = "obj"  # `trace` in a docstring

rst_prolog = ".. currentmodule:: hbgear\n"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # types are in the sections Parameters
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False  # overridden methods of base classes are documented there
napoleon_google_docstring = False
napoleon_use_param = False  # parameters with a common description stay together
napoleon_use_ivar = True  # attributes are a list: fields that are documented as members are not described twice
napoleon_use_rtype = False
napoleon_attr_annotations = False

sphinx_gallery_conf = {
    "examples_dirs": ["scripts/tutorials", "scripts/gallery"],
    "gallery_dirs": ["tutorials", "gallery"],
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "doc_module": ("hbgear",),
    "image_scrapers": ("matplotlib",),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "write_computation_times": False,
    "ignore_repr_types": r"matplotlib[.](axes|figure)",
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 10,
    "reset_modules": ("looks.reset",),
}

html_theme = "furo"
html_title = f"hbgear {version}"
html_static_path = ["_site/static", mathml.font()]
html_math_renderer = "mathml"
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_search_summary = False  # a browser refuses to read the pages of a site that is opened from files
