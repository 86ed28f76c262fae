"""The page of `guide` in the middle of a placement: `python docs/figures/guided_page.py`.

Needs Chromium. The arm is emulated. What comes after it, up to the verdict, is told on the screen.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
REPOSITORY = FOLDER.parents[1]
sys.path.insert(0, str(REPOSITORY / "tests" / "support"))

from chromium import WITH_WEBGL, Chromium

# So many landmarks are measured in the picture.
MEASURED = 8
TAKEN = "document.querySelectorAll('#chips .taken').length"


def copied_job(folder: Path) -> Path:
    """The job of the SUTA without its samples, as before the first measurement."""
    source, job = REPOSITORY / "data" / "suta", folder / "suta" / "calibration.yaml"
    job.parent.mkdir()
    text = (source / "calibration.yaml").read_text()
    job.write_text(text.replace("../../urdf/", f"{REPOSITORY}/urdf/"))
    shutil.copy(source / "artefact.yaml", job.parent)
    return job


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shots", type=Path, help="folder for pictures of later states as well")
    shots = parser.parse_args().shots
    with tempfile.TemporaryDirectory() as folder, Chromium(*WITH_WEBGL) as page:
        job = copied_job(Path(folder))
        words = ["guide", str(job), "--emulate", "--port", "0", "--no-open"]
        command = [sys.executable, "-m", "suta_calib", *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as guide:
            assert guide.stdout is not None
            try:
                opened = next(line for line in guide.stdout if line.startswith("Open http:"))
                page.open(opened.split()[1])
                page.wait(f"{TAKEN} === {MEASURED}")
                page.picture(FOLDER / "guided_page.png")
                if shots:
                    later(page, shots)
            finally:
                guide.terminate()


def later(page: Chromium, shots: Path) -> None:
    """The complete placement, and the verdict, wide and narrow."""
    shots.mkdir(exist_ok=True)

    def shot(name: str) -> None:
        for width in (1400, 500):
            page.resize(width, 900)
            page.picture(shots / f"{name}_{width}.png")
        page.resize(1400, 900)

    page.wait("document.body.innerText.includes('Best next')")
    shot("complete")
    page.evaluate("document.querySelector('[data-do=finish]').click()")
    page.wait("document.querySelectorAll('#files a').length")
    shot("verdict")


if __name__ == "__main__":
    main()
