"""Configuration of the documentation."""

import functools
import importlib.metadata
import os
import sys
import tomllib
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

# Not from the installed package's metadata, which an old checkout may have written.
_PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
urls = tomllib.loads(_PYPROJECT.read_text(encoding="utf-8"))["project"]["urls"]

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "matplotlib.sphinxext.plot_directive",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
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
# These have no pages beside them.
html_sidebars = {name: [] for name in ("index", "install", "quickstart", "search")}
html_theme_options = {
    "logo": {"text": "skfmap"},
    "github_url": urls["Source"],
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "navigation_depth": 2,
    "show_toc_level": 2,
    "show_prev_next": False,
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
    "footer_start": ["copyright"],
    "footer_end": [],
}
# Buttons copy what is to be typed: no prompts, and no output.
copybutton_prompt_text = r">>> |\.\.\. "
copybutton_prompt_is_regexp = True
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
if version == "0.1.0":  # not released yet, so that its own addresses lead nowhere
    linkcheck_ignore += [rf"{urls[name]}.*" for name in ("Homepage", "Source")]

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "generated/gallery",
    "within_subsection_order": "FileNameSortKey",
    # What the templates of autosummary show as "Examples using".
    "backreferences_dir": "generated/backreferences",
    "doc_module": ("skfmap",),
    "inspect_global_variables": True,
    "thumbnail_size": (600, 420),
    "filename_pattern": "plot_",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
}
