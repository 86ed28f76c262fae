"""What stands elsewhere in the repository, as pages: Markdown, examples, notebooks."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Where such a file, or what the code there says of itself, is a page here.
PAGES = {
    "ARCHITECTURE.md": "generated/design.md",
    "CHANGELOG.md": "generated/changelog.md",
    "CONTRIBUTING.md": "generated/contributing.md",
    "examples": "generated/examples.md",
    "examples/README.md": "generated/examples.md",
    "suta_calib/__init__.py": "generated/api.md",
    "suta_calib/exchange": "generated/formats.md",
    "suta_calib/terms": "generated/observations.md",
    "suta_calib/job/keys.py": "generated/files.md",
    "suta_calib/device/device_file.py": "generated/files.md#device-yaml",
    "data/accuracy/iso10360.yaml": "generated/files.md#iso10360-yaml",
    "data/suta/artefact.yaml": "generated/files.md#artefact-yaml",
    "data/suta/simulation.yaml": "generated/files.md#simulation-yaml",
}
EXAMPLES = sorted(path.parent.name for path in ROOT.glob("examples/*/README.md"))
PAGES |= {f"examples/{name}": f"generated/examples/{name}.md" for name in EXAMPLES}
_LINK = re.compile(r"(?<!!)\[([^\]\n]*)\]\((?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?\)")


def examples_listed() -> str:
    """The examples' pages below their table."""
    listed = "\n".join(f"examples/{name}" for name in EXAMPLES)
    return f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def relinked(text: str, source: Path, target: Path) -> str:
    """Markdown of the repository as a page of the site: links to no page become names of files.

    Args:
        text: the Markdown.
        source: folder that its links are relative to, from the repository's root.
        target: folder of the page, from the same root.
    """

    def link(found: re.Match[str]) -> str:
        shown, to, section = found[1], found[2], found[3] or ""
        name = os.path.normpath(source / to)
        if name in PAGES or name.startswith("docs/"):
            page = f"docs/{PAGES[name]}" if name in PAGES else name
            return f"[{shown}]({os.path.relpath(page, target)}{section})"
        if name.startswith("notebooks/") and name.endswith(".ipynb"):
            page = f"docs/generated/{name}"
            return f"[{shown}]({os.path.relpath(page, target)}{section})"
        plain = shown.strip("`")
        return f"`{name}`" if plain in (name, to, Path(name).name) else f"{shown} (`{name}`)"

    return _LINK.sub(link, text)


def shown_notebook(path: Path) -> str:
    """A notebook as it is stored, its links for the site."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    for each in notebook["cells"]:
        if each["cell_type"] == "markdown":
            text = "".join(each["source"])
            each["source"] = relinked(text, Path("notebooks"), Path("docs/generated/notebooks"))
    return json.dumps(notebook, ensure_ascii=False)


def shown_file(name: str) -> str:
    """A Markdown file of the repository as a page: an example's among those of examples."""
    text = (ROOT / name).read_text(encoding="utf-8")
    folder = Path(name).parent
    below = "examples" if folder.name in EXAMPLES else ""
    return relinked(text, folder, Path("docs/generated", below))
