"""The script that turns a scene, in a real browser: what it draws is what the page holds."""

from __future__ import annotations

import re
import shutil
import subprocess
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


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_a_scene_is_drawn_alike_by_the_page_and_by_its_script(
    result: Calibration, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    page.write_text(page_with(calibration_document(result), None).replace("</body>", PROBE))
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    flags += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command = [str(CHROMIUM), *flags, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"]
    run = subprocess.run([*command, page.as_uri()], capture_output=True, text=True, check=True)
    found = re.search(r"<title>(\S+) (\d+) (\d+)</title>", run.stdout)
    assert found, run.stderr[-2000:]
    assert float(found[1]) < 0.11  # both round to a tenth of a pixel
    assert int(found[2]) > 6
    assert int(found[3]) > 6
