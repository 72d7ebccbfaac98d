"""How the site is built: `make site`."""

import json
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from matplotlib.figure import Figure
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator
from sphinx_gallery.scrapers import figure_rst

from modalmotion.classification import available_models, card_markdown, load_model

_ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(_ROOT / "tools"))
from http_reference import http_reference  # noqa: E402
from play import play_page, sample_stream  # noqa: E402

_PROJECT = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = "modalmotion"
author = "The modalmotion maintainers"
project_copyright = author
release = version = _PROJECT["version"]
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["notebook.ipynb", "gallery/README.rst", "**sg_execution_times.rst"]
# A link to a file of the sources that is no page of the site.
suppress_warnings = ["myst.xref_missing", "config.cache"]
# An option such as --seconds has two hyphens.
smartquotes = False
html_theme = "furo"
html_title = "modalmotion"
# Formulas are MathML: the pages load nothing, and read from disk as they do from a server.
html_math_renderer = "mathml"
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


def _inline(page: HTML5Translator, node: nodes.math) -> None:
    page.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(page: HTML5Translator, node: nodes.math_block) -> None:
    page.body.append(tex2mathml(node.astext(), as_block=True))
    raise nodes.SkipNode


def _write_pages(_: Sphinx) -> None:
    """Write pages of texts that are elsewhere: cards in the files of models, and the root's."""
    folder = Path(__file__).parent / "_made"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name in available_models():
        model = load_model(name)
        card = card_markdown(model.name, model.id, model.card)
        (folder / f"model-{name}.md").write_text(card, encoding="utf-8")
    interface = json.loads((_ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8"))
    (folder / "calls.md").write_text(http_reference(interface), encoding="utf-8")
    for name in ("SECURITY.md", "CHANGELOG.md"):
        text = (_ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](../")
        (folder / name).write_text(text, encoding="utf-8")


def _link_to_pages(_: Sphinx, __: str, source: list[str]) -> None:
    """Lead links to sources of pages to the pages."""
    for file, page in _PAGES.items():
        source[0] = source[0].replace(f"]({file})", f"]({page})")


_PAGES = {
    "gallery/README.rst": "_gallery/index.rst",
    "../SECURITY.md": "_made/SECURITY.md",
    "../CHANGELOG.md": "_made/CHANGELOG.md",
}


def _write_play_page(app: Sphinx, error: Exception | None) -> None:
    """Write the page with the heart beside the page that shows it."""
    if error is None and app.builder.format == "html":
        (Path(app.outdir) / "heart.html").write_text(play_page(sample_stream()), encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Add formulas, model cards and the page to play with."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("builder-inited", _write_pages)
    app.connect("source-read", _link_to_pages)
    app.connect("build-finished", _write_play_page)
