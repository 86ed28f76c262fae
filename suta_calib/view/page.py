"""A scene in one file that opens offline: viser's own page, which plays the samples."""

from __future__ import annotations

from html import escape
from pathlib import Path

from suta_calib.plotting.scene import drawn_rows
from suta_calib.view.scene import ArmScene
from suta_calib.view.server import EACH_S, Viewer, factors, headline, legend, paragraphs

# Over the scene's upper right corner, for viser's own messages stand in the left one. Where it
# would cover the scene it is folded to one line; on a telephone above the bar that plays.
_STYLE = """<style>
#suta-calib { position: fixed; right: 0; top: 0; z-index: 1; width: 24em; max-width: 100vw;
  max-height: 80vh; overflow: auto; background: #fffd; color: #000; font: 15px sans-serif;
  border-bottom-left-radius: .4em; }
#suta-calib summary { padding: .5em 1em; cursor: pointer; overflow-wrap: anywhere;
  font-weight: 600; }
#suta-calib:not([open]) { width: auto; }
@media (max-width: 40em) {
  #suta-calib { top: auto; bottom: 2.6rem; width: 100vw; max-height: 50vh; } }
@media (prefers-color-scheme: dark) {
  #suta-calib { background: #1a1a1aee; color: #e6e6e6; } #suta-calib a { color: #7db8ee; } }
</style>"""
_FOLDED = """<script>
if (innerWidth < 1000) document.getElementById("suta-calib").open = false;
</script>"""
_LIGHT = "__VISER_EMBED_CONFIG__={darkMode:false}"
_AS_ASKED = '__VISER_EMBED_CONFIG__={darkMode:matchMedia("(prefers-color-scheme: dark)").matches}'


def page(scene: ArmScene) -> bytes:
    """A scene as one HTML file, which needs no network.

    It begins at the first sample and plays the others; of many it plays some, evenly spread.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
    """
    with Viewer(scene, port=0) as viewer:
        recording = viewer.server.get_scene_serializer()
        for row in range(len(scene.rows))[drawn_rows(len(scene.rows))]:
            viewer.show_row(row)
            recording.insert_sleep(EACH_S)
        html = recording.as_html()
    enlarged = ", ".join(f"{what} × {factor:g}" for what, factor in factors(scene))
    above = headline(scene) + legend(scene) + paragraphs([enlarged])
    if scene.assessment is not None and scene.assessment.notes:
        notes = paragraphs(map(escape, scene.assessment.notes))
        above += f"<details><summary>Notes</summary>{notes}</details>"
    word = "" if scene.assessment is None else f": {scene.assessment.word}"
    summary = f"<summary>{escape(Path(scene.title).name)}{escape(word)}</summary>"
    panel = f'{_STYLE}<details id="suta-calib" open>{summary}{above}</details>{_FOLDED}'
    html = html.replace("<title>Viser", f"<title>{escape(scene.title)}", 1)
    html = html.replace('"Viser client"', f'"{escape(scene.summary)}"', 1)
    html = html.replace(_LIGHT, _AS_ASKED, 1)
    return html.replace("<noscript>", f"{panel}<noscript>", 1).encode()
