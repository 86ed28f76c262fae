"""A scene in one file that opens offline: viser's own page, which plays the samples."""

from __future__ import annotations

from html import escape

from suta_calib.plotting.scene import drawn_rows
from suta_calib.view.scene import ArmScene
from suta_calib.view.server import EACH_S, Viewer, factors, headline, paragraphs

# Over the scene's upper left corner; what is below it can still be turned.
_STYLE = (
    "position:fixed;left:0;top:0;z-index:1;max-width:30em;max-height:100vh;overflow:auto;"
    "background:#fffc;color:#000;font-family:sans-serif;pointer-events:none"
)


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
    above = headline(scene) + paragraphs([enlarged])
    if scene.assessment is not None and scene.assessment.notes:
        notes = paragraphs(map(escape, scene.assessment.notes))
        summary = '<summary style="padding:0 1em;font-size:85%">Notes</summary>'
        above += f'<details style="pointer-events:auto">{summary}{notes}</details>'
    html = html.replace("<title>Viser", f"<title>{escape(scene.title)}", 1)
    html = html.replace('"Viser client"', f'"{escape(scene.summary)}"', 1)
    return html.replace("<noscript>", f'<div style="{_STYLE}">{above}</div><noscript>', 1).encode()
