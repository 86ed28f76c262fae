"""Run a notebook and print it as a page of text: ``python notebooks/print_page.py NOTEBOOK``.

Prose, tables and what the cells print; code is left out, and a picture is named only.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from rich.console import Console
from rich.markdown import Markdown


def main(path: Path) -> None:
    """Run the notebook in its own folder and print it; the file stays as it is."""
    notebook = nbformat.read(path, as_version=4)
    folder = {"metadata": {"path": str(path.resolve().parent)}}
    NotebookClient(notebook, kernel_name="python3", timeout=600, resources=folder).execute()
    console = Console()
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            console.print(Markdown(cell.source))
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "text/markdown" in data:
                console.print(Markdown(data["text/markdown"]))
            elif "image/png" in data:
                console.print("(a picture: see the notebook)", style="dim")
            else:
                console.print(output.get("text", data.get("text/plain", "")), markup=False)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
