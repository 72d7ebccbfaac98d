"""How the site is built: `make site`."""

import tomllib
from pathlib import Path

_PROJECT = tomllib.loads(
    (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
)["project"]

project = "modalmotion"
author = copyright = "The modalmotion maintainers"
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
exclude_patterns = ["_build", "notebook.ipynb"]
nitpicky = False
html_theme = "furo"
html_title = "modalmotion"
html_static_path = []
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
numpydoc_show_class_members = False
autosummary_generate = True
sphinx_gallery_conf = {
    "examples_dirs": ["gallery"],
    "gallery_dirs": ["_gallery"],
    "abort_on_example_error": True,
    "show_memory": False,
    "min_reported_time": 1e9,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_signature": False,
}
