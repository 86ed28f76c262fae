"""A scene in the browser, with sliders and a play button."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from html import escape
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
import rich

from suta_calib.arrays import FloatArray
from suta_calib.errors import OutputError
from suta_calib.optional_packages import load
from suta_calib.units import Unit, shown, stored
from suta_calib.view.access import Access, Site, check_port
from suta_calib.view.drawing import (
    CALIBRATED,
    NOMINAL,
    ShownArm,
    camera_view,
    draw,
    draw_floor,
    ellipsoid_scales,
    spheres,
    wxyz,
)
from suta_calib.view.scene import (
    OUTLYING,
    ArmScene,
    Colour,
    Ellipsoids,
    ErrorVectors,
    Frame,
    Frustum,
)

if TYPE_CHECKING:
    import viser

    from suta_calib.model.chain import ChainJoint

# How long a sample is shown, s.
EACH_S: Final = 0.25
_SAMPLE: Final[Colour] = (110, 110, 110)
_LEVELS: Final = {"good": "#009E73", "care": "#B8860B", "bad": "#D55E00"}


class Viewer:
    """A scene on a port of this computer; a context manager.

    Args:
        scene: what is shown.
        port: to listen on; 0 for any that is free.
        host: who may look: this computer only; ``0.0.0.0`` lets whoever on the network has the
            address.
        site: pages beside the scene, at the same address; the scene then stands below ``scene/``.

    Attributes:
        shown: number of the sample that the arms are at.
        arms: as they are drawn.
        joints: sliders of the panel, one for each joint that has a reading, degrees or mm.
        inflation: how many times as wide as they are uncertainties are drawn.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
        OutputError: the port cannot be had.
    """

    def __init__(
        self,
        scene: ArmScene,
        port: int = 8080,
        host: str = "127.0.0.1",
        site: Site | None = None,
    ) -> None:
        self.scene, self.shown, self.inflation = scene, 0, scene.inflation
        self._access = Access(host, site)
        self.server: viser.ViserServer = _server(port, host, self._access)
        api = self.server.scene
        api.set_up_direction("+z")
        view = self.server.initial_camera
        view.position, view.look_at = camera_view(scene)
        draw_floor(api, scene)
        self.arms = [ShownArm(api, arm, solid=k == 0) for k, arm in enumerate(scene.arms)]
        self._handles = {}
        for thing in scene.things:
            carrier = getattr(thing, "carrier", "")
            above = self.arms[0].node(carrier) if carrier else ""
            self._handles[thing.name] = draw(thing, api, f"{above}/{thing.name}", scene)
        self._chosen: Any = None
        self._tip: Any = None
        # Sliders, clicks and the play button each come from a thread of their own.
        self._moving = threading.RLock()
        self.joints: list[Any] = []
        self._units: list[Unit] = []
        self._following = False
        if len(scene.rows):
            self._draw_rows()
        self.move(scene.q)

    def _repr_html_(self) -> str:
        """In a notebook: the page, as long as this object is there."""
        return f'<iframe src="{self.url}" style="width:100%;height:500px;border:0"></iframe>'

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def mark(self) -> float:
        """Radius of a sample's mark, m."""
        # Many would hide what is between them.
        many = 300
        share = 0.003 if len(self.scene.rows) <= many else 0.002
        return share * float(np.linalg.norm(np.ptp(self.scene.extent, axis=0)))

    @property
    def url(self) -> str:
        """Where to look: the address, with the key that the server asks for (`Access`)."""
        host = self.server.get_host()
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{self.server.get_port()}/{self._access.token}/"

    def close(self) -> None:
        """Let go of the port."""
        with _silent():
            self.server.stop()

    def move(self, q: FloatArray) -> None:
        """Show the arms at readings (joints,), rad or m."""
        with self._moving, self.server.atomic():
            self._q = q
            for arm in self.arms:
                arm.move(q)

    def show_row(self, row: int) -> None:
        """Show the arms at a sample, and its name."""
        rows = self.scene.rows
        with self._moving, self.server.atomic():
            self.shown = row
            self.move(rows.q[row])
            self._chosen.position = rows.at[row]
            self._chosen.text = rows.names[row]
            self._follow()

    def magnify(self, factor: float) -> None:
        """Draw errors ``factor`` times as long as they are."""
        for arrows in (t for t in self.scene.things if isinstance(t, ErrorVectors)):
            self._handles[arrows.name].points = arrows.ends(factor).astype(np.float32)

    def inflate(self, factor: float) -> None:
        """Draw uncertainties ``factor`` times as wide as they are."""
        self.inflation = factor
        for thing in (t for t in self.scene.things if isinstance(t, Ellipsoids)):
            self._handles[thing.name].batched_scales = ellipsoid_scales(thing, factor)

    def show_tip(self, tip: Ellipsoids, label: str) -> None:
        """Show how sure the tip is: one ellipsoid, drawn at its factor, and a line of text."""
        if self._tip is None:
            self._tip = draw(tip, self.server.scene, "/tip", self.scene)
            self._said = self.server.scene.add_label("/tip_is", label)
        with self.server.atomic():
            self._tip.batched_positions = tip.at.astype(np.float32)
            self._tip.batched_wxyzs = wxyz(tip.turn).astype(np.float32)
            self._tip.batched_scales = ellipsoid_scales(tip, self.inflation)
            self._said.position, self._said.text = tip.at[0], label

    def _draw_rows(self) -> None:
        api, rows = self.server.scene, self.scene.rows
        size = self.mark
        colours = np.where(rows.outlying[:, None], OUTLYING, _SAMPLE)
        marks = spheres(api, "/samples", rows.at, np.full(3, size), colours)
        marks.on_click(self._clicked)
        self._chosen = api.add_label("/name of the sample", rows.names[0], position=rows.at[0])

    def _clicked(self, event: Any) -> None:
        """Viser does not always know which of the marks was hit, nor whether one was."""
        row = event.instance_index
        if row is None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            # A click may pass a sample so many radii of its mark away.
            row = self.scene.rows.along(*ray, 3.0 * self.mark)
        if row is not None:
            self.choose(row)

    # ── the panel ───────────────────────────────────────────────────────────────────────────
    def add_panel(self) -> None:
        """Put up what is chosen with: joints, samples, factors, and what is shown at all."""
        gui, scene = self.server.gui, self.scene
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label("suta-calib")
        gui.add_html(headline(scene))
        if scene.assessment is not None and scene.assessment.notes:
            with gui.add_folder("Notes", expand_by_default=False):
                gui.add_html(paragraphs(map(escape, scene.assessment.notes)))
        if len(scene.rows):
            with gui.add_folder("Samples"):
                self._add_samples()
        with gui.add_folder("Magnification"):
            change: dict[str, Callable[[float], None]] = {
                "errors": self.magnify,
                "uncertainty": self.inflate,
            }
            for what, factor in factors(scene):
                self._add_factor(f"{what} ×", factor, change[what])
        with gui.add_folder("Legend"):
            gui.add_html(legend(scene))
        with gui.add_folder("Joints", expand_by_default=not len(scene.rows)):
            self._add_joints()
        with gui.add_folder("Shown"):
            for path in dict.fromkeys(self._groups()):
                self._add_switch(path)

    def _groups(self) -> list[str]:
        """Nodes that are shown or hidden as one."""
        things = (f"/{t.name.partition('/')[0]}" for t in self.scene.things)
        arms = [arm.root for arm in self.arms]
        return [
            *arms,
            *things,
            *(["/samples", "/name of the sample"] if len(self.scene.rows) else []),
        ]

    def _add_switch(self, path: str) -> None:
        node = self.server.scene.get_handle_by_name(path) or self.server.scene.add_frame(
            path, show_axes=False
        )
        box = self.server.gui.add_checkbox(path.removeprefix("/"), initial_value=True)

        @box.on_update
        def _(_: Any) -> None:
            node.visible = box.value

    def _add_factor(self, label: str, first: float, change: Callable[[float], None]) -> None:
        slider = self.server.gui.add_slider(label, 0.0, 10.0 * first, first / 10.0, first)
        slider.on_update(lambda _: change(slider.value))

    def _add_joints(self) -> None:
        arm, scene = self.arms[0].drawn.arm, self.scene
        readings = np.vstack([scene.q, scene.rows.q]) if len(scene.rows) else scene.q[None]
        self.joints = [
            _joint_slider(self.server.gui, joint, column)
            for joint, column in zip(arm.readings, readings.T, strict=True)
        ]
        self._units = list(arm.units.values())
        for k, (slider, unit) in enumerate(zip(self.joints, self._units, strict=True)):
            slider.on_update(
                lambda event, k=k, unit=unit: self._turn(k, stored(event.target.value, unit))
            )

    def _turn(self, joint: int, reading: float) -> None:
        if not self._following:
            q = self._q.copy()
            q[joint] = reading
            self.move(q)

    def _follow(self) -> None:
        """Have the sliders say where the arm is, from where they go on."""
        self._following = True
        try:
            for slider, reading, unit in zip(self.joints, self._q, self._units, strict=False):
                slider.value = round(shown(float(reading), unit), 2)
        finally:
            self._following = False

    def _add_samples(self) -> None:
        gui, rows = self.server.gui, self.scene.rows
        self._row: Any = gui.add_slider("sample", 0, max(len(rows) - 1, 1), 1, 0)
        self._play: Any = gui.add_checkbox("play", initial_value=False)
        self._row.on_update(lambda _: self.show_row(min(self._row.value, len(rows) - 1)))
        self._play.on_update(lambda _: self._start())

    def choose(self, row: int) -> None:
        """Show a sample, and say so in the panel."""
        self._row.value = row

    def _start(self) -> None:
        if self._play.value:
            threading.Thread(target=self._run, name="play", daemon=True).start()

    def _run(self) -> None:
        while self._play.value:
            self.choose((self.shown + 1) % len(self.scene.rows))
            time.sleep(EACH_S)


def headline(scene: ArmScene) -> str:
    """What is shown, and whether it may be used, as HTML."""
    lines = [f"<b>{escape(scene.title)}</b>"]
    if (verdict := scene.assessment) is not None:
        word = f'<b style="color:{_LEVELS[verdict.level]}">{escape(verdict.word)}</b>'
        lines.append(f"{word}. {escape(verdict.statement)}")
    return paragraphs([*lines, escape(scene.summary)])


def legend(scene: ArmScene) -> str:
    """What each colour of a scene stands for, as HTML."""
    rows = [
        f'<span style="color:rgb{_lit(colour)};font-size:130%">{sign}</span> {escape(words)}'
        for sign, colour, words in _looks(scene)
    ]
    if any(isinstance(thing, Frame) and not isinstance(thing, Frustum) for thing in scene.things):
        axes = zip("xyz", ("#d00", "#0a0", "#24f"), strict=True)
        signs = " ".join(f'<b style="color:{colour}">{axis}</b>' for axis, colour in axes)
        rows.append(f"{signs} axes of a frame")
    return paragraphs(rows)


def _lit(colour: Colour) -> Colour:
    """About how a colour looks in the scene's light."""
    red, green, blue = (round(255.0 * (part / 255.0) ** 0.6) for part in colour)
    return red, green, blue


def _looks(scene: ArmScene) -> Iterator[tuple[str, Colour, str]]:
    """A sign, its colour, and what it stands for; each once."""
    for k, arm in enumerate(scene.arms):
        yield "━", NOMINAL if k else CALIBRATED, f"{arm.name} arm"
    named = set[str]()
    for thing in scene.things:
        group, _, name = thing.name.partition("/")
        what = name.partition(" ")[0] if isinstance(thing, ErrorVectors) else group
        if what in named or isinstance(thing, Frame):
            continue
        named.add(what)
        if isinstance(thing, ErrorVectors):
            usual = thing.colours[(thing.colours != OUTLYING).any(axis=1)]
            red, green, blue = map(int, (usual if len(usual) else thing.colours)[0])
            few = f" ({len(thing.at)} of {thing.count:,}: the largest error in each region)"
            words = f"errors of the {what} data{few if thing.count else ''}"
            yield "➔", (red, green, blue), words
        elif isinstance(thing, Ellipsoids):
            yield "●", thing.colour, "uncertainty of the tip (one standard deviation)"
        else:
            yield "●", thing.colour, group.removesuffix("s")
    if len(scene.rows):
        yield "●", _SAMPLE, "samples: a click shows the name"
        if scene.rows.outlying.any():
            yield "●", OUTLYING, "outlier: larger than chance explains"


def paragraphs(lines: Iterable[str]) -> str:
    """Lines of HTML below each other, in small letters; those that are empty are left out."""
    style = "padding:0 1em;font-size:85%;overflow-wrap:anywhere"  # a path has no blanks
    shown_lines = "".join(f'<p style="margin:0.3em 0">{line}</p>' for line in lines if line)
    return f'<div style="{style}">{shown_lines}</div>'


def factors(scene: ArmScene) -> Iterator[tuple[str, float]]:
    """What is drawn larger than it is, and how many times at first."""
    for kind, what, factor in (
        (ErrorVectors, "errors", scene.magnification),
        (Ellipsoids, "uncertainty", scene.inflation),
    ):
        if any(isinstance(thing, kind) for thing in scene.things):
            yield what, factor


def _joint_slider(gui: viser.GuiApi, joint: ChainJoint, readings: FloatArray) -> Any:
    """A slider in degrees or mm, within the limits and wherever the samples are; at the first."""
    unit: Unit = "m" if joint.type == "prismatic" else "rad"
    # A joint without limits turns once; a slide without them goes a metre each way.
    beyond = 1.0 if unit == "m" else np.pi
    low = joint.lower if np.isfinite(joint.lower) else -beyond
    high = joint.upper if np.isfinite(joint.upper) else beyond
    low, high = min(low, readings.min()), max(high, readings.max())
    values = [round(shown(float(value), unit), 2) for value in (low, high, readings[0])]
    return gui.add_slider(
        f"{joint.name}, {'mm' if unit == 'm' else '°'}", values[0], values[1], 0.01, values[2]
    )


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Within it rich says nothing, by which viser announces that it begins and ends."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _server(port: int, host: str, access: Access) -> viser.ViserServer:
    library = load("viser", "view")
    # Viser would go on to the next ports, and wait for ever for a host that is none.
    check_port(port, host)
    with _silent(), access.guarding():
        server: viser.ViserServer = library.ViserServer(host=host, port=port, verbose=False)
    if not access.guards:
        with _silent():
            server.stop()
        raise OutputError(
            f"{host}:{port}: found a version of viser that answers every computer in the "
            "network; expected viser 1.1"
        )
    # What a broken message raises in a task of the server's is no news either.
    loop = server.get_event_loop()
    loop.call_soon_threadsafe(loop.set_exception_handler, lambda *_: None)
    return server
