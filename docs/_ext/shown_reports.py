"""Reports of examples, made anew by every build beside its pages: what a command leaves to read."""

from __future__ import annotations

import io
import shutil
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from repository_pages import ROOT

from suta_calib.cli._app import run

# By the name that `docs/gallery.md` links to.
REPORTS = {
    "ur5": ("calibrate", "examples/ur5_laser_tracker/calibration.yaml"),
    "suta": ("calibrate", "data/suta/calibration.yaml"),
    "hand_eye": ("hand-eye", "data/poses/hand_eye.csv", "--model", "AX=ZB"),
}


def write(folder: Path) -> None:
    """Run the commands, and keep their reports."""
    folder.mkdir(exist_ok=True)
    for name, (command, file, *options) in REPORTS.items():
        with tempfile.TemporaryDirectory() as out, redirect_stdout(io.StringIO()) as said:
            with redirect_stderr(said):
                code = run([command, str(ROOT / file), *options, "--out", out])
            if code:
                raise RuntimeError(f"{command} {file} ended with {code}: {said.getvalue()}")
            shutil.copy(Path(out) / "report.html", folder / f"{name}.html")
