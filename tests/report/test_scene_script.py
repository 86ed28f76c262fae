"""Scripts of a page in a real browser: what turns a scene, and what saves a figure."""

from __future__ import annotations

import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest

from suta_calib.job.calibration import Calibration
from suta_calib.report.calibration import calibration_document
from suta_calib.report.page import page_with

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
# Drags the picture by nothing, and then by something; the title tells what became of it.
PROBE = """<script>
const svg = document.querySelector(".scene > svg");
svg.setPointerCapture = () => {};
const drawn = () => [...svg.querySelectorAll("path, text")].map(
  (each) => each.getAttribute("d") || `${each.getAttribute("x")} ${each.getAttribute("y")}`);
const drag = (kind, x, y) => svg.dispatchEvent(new PointerEvent(kind, {clientX: x, clientY: y}));
const numbers = (text) => (text.match(/-?[0-9.]+/g) || []).map(Number);
const before = drawn();
drag("pointerdown", 10, 10);
drag("pointermove", 10, 10);
const still = drawn();
const apart = before.flatMap((text, k) => {
  const one = numbers(text), other = numbers(still[k]);
  return one.length === other.length ? one.map((value, i) => Math.abs(value - other[i])) : [1e9];
});
drag("pointermove", 90, 40);
const turned = drawn().filter((text, k) => text !== still[k]).length;
document.title = `${Math.max(...apart)} ${before.length} ${turned}`;
</script></body>"""


# Presses every button, and draws what it would save; the title tells of each its size and how many
# colours it has.
SAVES = """<script>
const files = [], told = [];
HTMLAnchorElement.prototype.click = function () { files.push([this.download, this.href]); };
const look = ([name, address]) => new Promise((then) => {
  const picture = new Image();
  picture.onload = () => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [picture.naturalWidth, picture.naturalHeight];
    const to = canvas.getContext("2d");
    to.drawImage(picture, 0, 0);
    const drawn = to.getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set(new Uint32Array(drawn.buffer));
    then([name, canvas.width, canvas.height, colours.size].join("|"));
  };
  picture.onerror = () => then(name + "|0|0|0");
  picture.src = address;
});
addEventListener("load", async () => {
  const buttons = document.querySelectorAll(".save button");
  buttons.forEach((button) => button.click());
  while (files.length < buttons.length) await new Promise((then) => setTimeout(then, 20));
  document.title = (await Promise.all(files.map(look))).join(" ");
});
</script></body>"""


def dom_of(result: Calibration, script: str, folder: Path, *more: str) -> str:
    """What a browser makes of the page of a calibration and a script at its end."""
    page = folder / "page.html"
    page.write_text(page_with(calibration_document(result), None).replace("</body>", script))
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    flags += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command = [str(CHROMIUM), *flags, f"--user-data-dir={folder / 'profile'}", *more, "--dump-dom"]
    run = subprocess.run([*command, page.as_uri()], capture_output=True, text=True, check=True)
    return run.stdout


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_a_scene_is_drawn_alike_by_the_page_and_by_its_script(
    result: Calibration, tmp_path: Path
) -> None:
    found = re.search(r"<title>(\S+) (\d+) (\d+)</title>", dom_of(result, PROBE, tmp_path))
    assert found
    assert float(found[1]) < 0.11  # both round to a tenth of a pixel
    assert int(found[2]) > 6
    assert int(found[3]) > 6


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_every_figure_can_be_saved_as_svg_and_png(result: Calibration, tmp_path: Path) -> None:
    dom = dom_of(result, SAVES, tmp_path, "--virtual-time-budget=20000")
    # The first is the page's, the others are of figures.
    title, *_ = re.findall(r"<title>(.*?)</title>", dom)
    saved = [entry.split("|") for entry in unescape(title).split(" ")]
    names = {name for name, *_ in saved}
    assert {"scene.svg", "scene.png", "correlations.svg", "correlations.png"} <= names
    assert len(names) == len(saved) == 2 * dom.count("<figure")
    for name, width, height, colours in saved:
        # Nothing of the page is needed to draw it, and something is drawn.
        assert int(width) > (1900 if name.endswith("png") else 300)
        assert int(height) > 50
        assert int(colours) > 3, name
