"""The documentation site (`make docs`), made from this repository alone: nothing is fetched."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import docstrings
import generated
import name_pages
import shown_reports
from docutils.nodes import Text
from repository_pages import relinked
from sphinx.addnodes import desc_annotation

import suta_calib
from suta_calib.units import Unit

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx

project = "suta_calib"
version = release = suta_calib.__version__
author = "suta_calib maintainers"
project_copyright = author

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
]
exclude_patterns = ["_build", "_ext"]
html_theme = "furo"
html_title = "suta_calib"
html_static_path = ["_static"]
html_css_files = ["narrow_screens.css", "gallery.css"]
html_js_files = ["versions.js", "small_screens.js"]
html_show_sourcelink = False
html_copy_source = False
html_search_scorer = str(Path(__file__).parent / "search_order.js")
templates_path = ["_templates"]
html_sidebars = {
    "**": [
        "sidebar/brand.html",
        "versions.html",
        "sidebar/search.html",
        "sidebar/scroll-start.html",
        "sidebar/navigation.html",
        "sidebar/scroll-end.html",
    ]
}

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
# Notebooks are shown as they are stored: tests execute them.
nb_execution_mode = "off"

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
# `Name` in a docstring is a name of the package where there is one.
default_role = "py:obj"
# Of an attribute that several classes have, any one is not meant.
suppress_warnings = ["ref.python"]


# What a reader calls these, who does not want to know how NumPy spells them.
ARRAYS = {"float64": "FloatArray", "int64": "IntArray", "bool": "BoolArray", "str_": "StrArray"}
ARRAY = re.compile(
    r"~?(?:numpy\.)?ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], "
    r"~?(?:numpy\.)?dtype\[~?(?:numpy\.)?(\w+)\]\]"
)
UNIT = re.compile(rf"~?(?:typing\.)?{re.escape(str(Unit).removeprefix('typing.'))}")


def short(text: str) -> str:
    """Types by the package's own names."""
    return UNIT.sub("Unit", ARRAY.sub(lambda found: ARRAYS.get(found[1], found[0]), text))


def short_types(*event: Any) -> tuple[str | None, str | None]:
    """Of a signature."""
    *_, signature, returned = event
    return signature and short(signature), returned and short(returned)


def short_annotations(_: Sphinx, _domain: str, _kind: str, content: Element) -> None:
    """Of a property, which has no signature."""
    for annotation in content.parent.findall(desc_annotation):
        named = short(written := annotation.astext())
        if named != written:
            annotation.clear()
            annotation += Text(named)


def linked_here(_: Sphinx, page: str, content: list[str]) -> None:
    """A page that is kept links to files of the repository: here, to their pages."""
    if not page.startswith("generated/"):
        folder = Path("docs", page).parent
        content[0] = relinked(content[0], folder, folder)


def with_reports(app: Sphinx, failed: Exception | None) -> None:
    """The examples' reports beside the pages of the site, which link to them."""
    if failed is None and app.builder.format == "html":
        shown_reports.write(Path(app.outdir) / "reports")


def setup(app: Sphinx) -> None:
    """Write the pages that the package tells of itself before any page is read."""
    name_pages.import_names()
    app.connect("builder-inited", lambda _: generated.write(generated.DOCS / "generated"))
    app.connect("source-read", linked_here)
    app.connect("autodoc-process-signature", short_types)
    app.connect("object-description-transform", short_annotations)
    app.connect("autodoc-process-docstring", docstrings.prepared, priority=400)
    app.connect("build-finished", with_reports)
