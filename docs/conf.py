"""How the site is built: `make site`."""

import tomllib
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

_PROJECT = tomllib.loads(
    (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
)["project"]

project = "modalmotion"
author = "The modalmotion maintainers"
project_copyright = author
release = version = _PROJECT["version"]
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["notebook.ipynb", "gallery/README.rst"]
# A link to a file of the sources that is no page of the site.
suppress_warnings = ["myst.xref_missing", "config.cache"]
nitpicky = False
html_theme = "furo"
html_title = "modalmotion"
html_static_path = []
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
numpydoc_show_class_members = False
autosummary_generate = True


def _figures(
    _: tuple[str, str, int], block_vars: dict[str, Any], gallery_conf: dict[str, Any]
) -> str:
    """Keep what an example names `figure`: the package's figures are none of pyplot's."""
    figure = block_vars["example_globals"].pop("figure", None)
    if not isinstance(figure, Figure):
        return ""
    path = next(block_vars["image_path_iterator"])
    figure.savefig(path, dpi=100)
    return figure_rst([path], gallery_conf["src_dir"])


sphinx_gallery_conf = {
    "image_scrapers": ("matplotlib", _figures),
    "within_subsection_order": "FileNameSortKey",
    "examples_dirs": ["gallery"],
    "gallery_dirs": ["_gallery"],
    "abort_on_example_error": True,
    "show_memory": False,
    "min_reported_time": 1e9,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_signature": False,
}
