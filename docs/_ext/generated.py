"""Pages that the package writes about itself: files, kinds of observation, commands, names.

Each is made anew by every build into ``docs/generated``; nothing there is kept. What a reader of a
file checks (`suta_calib.measurements.fields`) is what the tables show: they cannot go stale.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from format_pages import formats_page
from hypothesis_pages import hypotheses_page
from message_pages import messages_page
from name_pages import api_index, api_pages, commands_page
from observation_pages import csv_page, observations_page
from repository_pages import EXAMPLES, ROOT, examples_listed, shown_file, shown_notebook
from result_pages import result_page
from yaml_pages import files_page

DOCS = ROOT / "docs"


def pages() -> dict[str, str]:
    """Every generated page: its name below ``docs/generated``, and its Markdown."""
    found = {
        "design.md": shown_file("ARCHITECTURE.md"),
        "changelog.md": shown_file("CHANGELOG.md"),
        "contributing.md": shown_file("CONTRIBUTING.md"),
        "examples.md": shown_file("examples/README.md") + examples_listed(),
        "csv.md": "".join(csv_page()),
        "result.md": "".join(result_page()),
        "hypotheses.md": "".join(hypotheses_page()),
        "files.md": "".join(files_page()),
        "observations.md": "".join(observations_page()),
        "messages.md": "".join(messages_page()),
        "formats.md": "".join(formats_page()),
        "commands.md": "".join(commands_page()),
        "api.md": "".join(api_index()),
    }
    found |= {f"examples/{name}.md": shown_file(f"examples/{name}/README.md") for name in EXAMPLES}
    return found | {f"api/{name}.md": text for name, text in api_pages()}


def write(folder: Path) -> None:
    """Write the generated pages, and copies of the notebooks beside them."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in pages().items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    (folder / "notebooks").mkdir()
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        (folder / "notebooks" / notebook.name).write_text(shown_notebook(notebook), "utf-8")
