"""Configuration of the documentation."""

import functools
import importlib.metadata
import os
import sys
import warnings
from pathlib import Path

# Shapes on these pages are so small that threads would only wait for each other; before numpy is
# imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "agg")
warnings.filterwarnings("ignore", message=".*non-interactive.*")

import skfmap.datasets  # noqa: E402


def _made_once(make):
    """Keep what a function made: most scripts of the gallery show the same creatures."""
    made = {}

    @functools.wraps(make)
    def make_or_look_up(*args, **parameters):
        key = repr((args, sorted(parameters.items())))
        if key not in made:
            made[key] = make(*args, **parameters)
        return made[key]

    return make_or_look_up


skfmap.datasets.make_creatures = _made_once(skfmap.datasets.make_creatures)

project = "skfmap"
author = "the skfmap developers"
copyright = "2026, the skfmap developers"
version = release = importlib.metadata.version("skfmap")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "matplotlib.sphinxext.plot_directive",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "formulas",
    "layers",
]
exclude_patterns = ["_build", "_templates"]
templates_path = ["_templates"]
autosummary_generate = True
autosummary_imported_members = True
toc_object_entries_show_parents = "hide"
autodoc_typehints = "none"  # docstrings say them, in words
numpydoc_show_class_members = False

# Every reference leads somewhere. Other packages are not looked up, since a build needs no network.
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(joblib|matplotlib|numpy|pandas|plotly|scipy|sklearn)\..*")]

html_theme = "pydata_sphinx_theme"
html_title = f"skfmap {version}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["skfmap.css"]
html_show_sourcelink = False
html_sidebars = {"index": [], "quickstart": [], "search": []}  # these have no pages beside them
html_theme_options = {
    "logo": {"text": "skfmap"},
    "navbar_align": "left",
    "navigation_depth": 2,
    "show_toc_level": 2,
    "show_prev_next": False,
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
    "footer_start": ["copyright"],
    "footer_end": [],
}
suppress_warnings = ["config.cache"]

# figures.py has the figures of the pages, layers.py the table of modules, formulas.py the formulas.
sys.path.insert(0, str(Path(__file__).parent))
plot_include_source = False
plot_html_show_source_link = False
plot_html_show_formats = False
plot_formats = [("png", 110)]
plot_rcparams = {"savefig.bbox": "tight"}
plot_apply_rcparams = True
plot_working_directory = str(Path(__file__).parent)

linkcheck_anchors = False  # of pages that are made by scripts
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_rate_limit_timeout = 60
linkcheck_allowed_redirects = {
    r"https://doi\.org/.*": r"https://.*",  # what a DOI is for
    r"https://[^/]*\.readthedocs\.io/?.*": r"https://[^/]*\.readthedocs\.io/.*",
}
# Publishers refuse programs; that they answer at all says that the DOI is known.
linkcheck_ignore = [r"https://(link\.springer\.com|dl\.acm\.org|onlinelibrary\.wiley\.com)/.*"]

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
