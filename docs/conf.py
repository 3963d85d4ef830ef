"""Configuration of the documentation."""

import importlib.metadata
import os
import sys
import warnings
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "agg")
warnings.filterwarnings("ignore", message=".*non-interactive.*")

project = "skfmap"
author = "the skfmap developers"
copyright = "2026, the skfmap developers"
version = release = importlib.metadata.version("skfmap")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.doctest",
    "sphinx.ext.mathjax",
    "matplotlib.sphinxext.plot_directive",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]
templates_path = []
autosummary_generate = True
autosummary_imported_members = True
numpydoc_show_class_members = False
html_theme = "pydata_sphinx_theme"
html_theme_options = {
    "logo": {"text": "skfmap"},
    "navbar_align": "left",
    "show_prev_next": False,
    "footer_start": ["copyright"],
    "footer_end": [],
}
suppress_warnings = ["config.cache"]

# Figures of the pages come from figures.py beside this file.
sys.path.insert(0, str(Path(__file__).parent))
plot_include_source = False
plot_html_show_source_link = False
plot_html_show_formats = False
plot_formats = [("png", 100)]
plot_working_directory = str(Path(__file__).parent)

linkcheck_anchors = False  # of pages that are made by scripts
linkcheck_timeout = 20

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "generated/gallery",
    "within_subsection_order": "FileNameSortKey",
    "backreferences_dir": None,
    "filename_pattern": "plot_",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
}
