"""One file that opens offline: what is in it, and that a browser shows it."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest
from cli_job import write_simulated_job
from matplotlib.image import imread
from simulated import ARMS, SUTA_URDF, arm_named, perturbed, random_readings
from viser_page import Held, held_by

from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.job.calibration import CalibrationJob, CalibrationResult
from suta_calib.view.calibration import calibration_scene, show
from suta_calib.view.drawn_arm import DrawnArm
from suta_calib.view.page import numbers_of, page
from suta_calib.view.scene import Arrows, Ellipsoids, Scene
from suta_calib.view.server import Viewer

pytest.importorskip("viser")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> CalibrationResult:
    job = write_simulated_job(tmp_path_factory.mktemp("job"), SUTA_URDF)
    return CalibrationJob.load(job).run()


@pytest.fixture(scope="module")
def scene(result: CalibrationResult) -> Scene:
    return calibration_scene(result.calibrated)


@pytest.fixture(scope="module")
def html(scene: Scene) -> bytes:
    return page(scene)


@pytest.fixture(scope="module")
def held(html: bytes) -> Held:
    return held_by(html)


def test_it_needs_no_network_and_says_whether_to_use_it(
    html: bytes, held: Held, scene: Scene
) -> None:
    assert not re.findall(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//[^"'\s>]+""", html.decode())
    said = "".join(m["props"]["content"] for m in held.messages if m["type"] == "GuiHtmlMessage")
    assert scene.assessment is not None
    assert scene.assessment.sentence in said
    assert scene.summary in said
    assert f"<title>{scene.title}</title>" in html.decode()
    assert len(html) < 2e6


def test_a_proxy_is_not_asked_for_this_computer(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("http_proxy", "https_proxy", "all_proxy", "ws_proxy", "wss_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")  # nobody listens there
    assert held_by(page(scene)).scene["q"] == pytest.approx(scene.q, abs=1e-9)


def test_the_page_begins_at_the_first_sample(
    held: Held, scene: Scene, result: CalibrationResult
) -> None:
    node = "/calibrated/links/tip"
    R, p = result.job.arm.forward(scene.rows.q[0], result.solution.values)
    np.testing.assert_allclose(held.last("SetPositionMessage", node)["position"], p, atol=1e-6)
    wxyz = held.last("SetOrientationMessage", node)["wxyz"]
    np.testing.assert_allclose(rotation_from_quaternion(np.roll(wxyz, -1)), R, atol=1e-6)


def test_arrows_are_as_long_as_errors_times_the_factor(held: Held, scene: Scene) -> None:
    drawn = held.made("ArrowMessage")
    told = {t.name: t for t in scene.things if isinstance(t, Arrows)}
    assert {name.lstrip("/") for name in drawn} == set(told)
    for name, props in drawn.items():
        begin, end = np.moveaxis(props["points"].reshape(-1, 2, 3), 1, 0)
        errors = np.linalg.norm(told[name.lstrip("/")].vector, axis=1)
        lengths = np.linalg.norm(end - begin, axis=1)
        np.testing.assert_allclose(lengths, scene.magnification * errors, atol=2e-6)


def test_ellipsoids_are_as_wide_as_the_uncertainty_times_the_factor(
    held: Held, scene: Scene
) -> None:
    (told,) = (t for t in scene.things if isinstance(t, Ellipsoids))
    props = held.made("BatchedMeshesMessage")["/uncertainty"]
    scales = props["batched_scales"].reshape(-1, 3)
    np.testing.assert_allclose(scales, np.maximum(scene.inflation * told.std, 1e-6), rtol=1e-5)
    assert np.abs(np.linalg.norm(props["vertices"].reshape(-1, 3), axis=1) - 1).max() < 1e-6


def test_every_sample_can_be_shown_and_is_named(held: Held, scene: Scene) -> None:
    assert held.scene["rows"]["names"] == list(scene.rows.names)
    np.testing.assert_allclose(held.scene["rows"]["q"], scene.rows.q, atol=1e-9)
    sliders = held.labelled("GuiSliderMessage")
    assert sliders["sample"]["props"]["max"] == len(scene.rows) - 1
    assert "play" in held.labelled("GuiCheckboxMessage")
    units = scene.arms[0].arm.units.values()
    for column, unit, label in zip(
        scene.rows.q.T, units, held.scene["controls"]["joints"], strict=True
    ):
        shown = np.degrees(column) if unit == "rad" else 1e3 * column
        assert sliders[label]["props"]["min"] <= shown.min() + 0.005
        assert sliders[label]["props"]["max"] >= shown.max() - 0.005


def test_factors_joints_and_samples_are_chosen_in_the_panel(scene: Scene) -> None:
    with Viewer(scene, port=0) as viewer:
        viewer.add_panel()
        (arrows,) = (t for t in scene.things if t.name == "errors/validation tracked point")
        viewer.magnify(7.0)
        drawn = viewer.server.scene.get_handle_by_name(f"/{arrows.name}").points
        np.testing.assert_allclose(drawn, arrows.ends(7.0), atol=1e-6)
        viewer.choose(3)
        assert viewer.shown == 3
        tip = viewer.server.scene.get_handle_by_name("/calibrated/links/tip")
        arm = scene.arms[0]
        expected = arm.arm.forward(scene.rows.q[3], arm.values)[1]
        np.testing.assert_allclose(tip.position, expected, atol=1e-6)
        # A click that viser cannot tell is the sample it passes, or none.
        passed = scene.rows.at[9] + np.array([0.0, 0.0, 2.0])
        for origin, row in ((passed, 9), (passed + 50.0, 9), (scene.rows.at[3], 3)):
            event = SimpleNamespace(
                instance_index=None, ray_origin=origin, ray_direction=(0, 0, -1)
            )
            viewer._clicked(event)
            assert viewer.shown == row
        # A slider in degrees moves the arm in radians, from where it is.
        assert viewer.joints[0].value == pytest.approx(np.degrees(scene.rows.q[3, 0]), abs=0.0051)
        viewer.joints[1].value = 30.0
        q = scene.rows.q[3].copy()
        q[1] = np.radians(30.0)
        np.testing.assert_allclose(tip.position, arm.arm.forward(q, arm.values)[1], atol=1e-6)


def test_a_result_shows_itself_and_so_does_any_solution(result: CalibrationResult) -> None:
    with result.view() as viewer, show(result.examined) as other:
        assert f'src="{viewer.url}"' in viewer._repr_html_()
        with urlopen(viewer.url) as answer:
            assert b"<html" in answer.read()[:2000]
        assert viewer.url != other.url
        assert other.scene.summary == viewer.scene.summary
        assert viewer.scene.title.endswith("calibration.yaml")
        assert other.scene.title == "arm.urdf"


# Hears what the page's server says to the client, and what it answers to each of some messages.
LISTENER = """<script>
const said = [], client = new Worker("");
client.onmessage = ({ data }) => said.push(data);
const listed = (_, each) => ArrayBuffer.isView(each) ? [...each] : each;
const plain = (value) => JSON.parse(JSON.stringify(value, listed));
async function listen(asked, arms) {
  client.postMessage({ type: "zstd_wasm" });
  client.postMessage({ type: "set_server", server: "ws://nowhere" });
  const offline = await client.connected;
  const first = said.map(({ type, messages }) => [type, (messages || []).length]);
  const answers = [];
  for (const message of asked) {
    said.length = 0;
    const { label, value } = message;
    client.postMessage({ type: "send", message: label === undefined ? message : {
      type: "GuiUpdateMessage", uuid: offline.uuids[label], updates: { value } } });
    await client.connected;
    answers.push(plain(said.flatMap(({ messages }) => messages)));
  }
  const shown = offline.shown;
  await new Promise((resolve) => setTimeout(resolve, 900));
  const told = { first, answers, played: offline.shown - shown,
                 poses: arms.map(({ arm, q }) => poses(arm, q)) };
  document.body.innerHTML = `<pre>${btoa(JSON.stringify(told))}</pre>`;
}
</script>"""


def in_a_browser(page: Path, *options: str) -> subprocess.CompletedProcess[str]:
    always = (
        *("--headless=new", "--no-sandbox", "--no-first-run", "--hide-scrollbars"),
        *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
        *("--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={page.parent / 'profile'}"),
    )
    return subprocess.run(
        [str(CHROMIUM), *always, *options, page.as_uri()],
        capture_output=True,
        text=True,
        check=True,
    )


@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to ask")
def test_what_is_moved_and_clicked_in_the_page_is_answered_as_by_the_viewer(
    html: bytes, held: Held, scene: Scene, tmp_path: Path
) -> None:
    ours = html[html.index(b'<script type="application/octet-stream"') :]
    ours = ours[: ours.index(b"</script>", ours.index(b"<script>")) + 9]
    rng = np.random.default_rng(3)
    drawn = [
        DrawnArm("any", arm, perturbed(arm.parameters, seed=2)) for arm in map(arm_named, ARMS)
    ]
    postures = [random_readings(each.arm, rng, 1)[0] for each in drawn]
    arms = [
        {"arm": numbers_of(each), "q": q.tolist()} for each, q in zip(drawn, postures, strict=True)
    ]
    ray = {"ray_origin": [0.0, 0.0, 5.0]}
    towards = scene.rows.at[5] - ray["ray_origin"]
    hit = {**ray, "ray_direction": (towards / np.linalg.norm(towards)).tolist()}
    missed = {**ray, "ray_direction": [0.0, 0.0, 1.0]}
    turned = list(held.scene["controls"]["joints"])[1]
    asked = [
        {"type": "SceneNodeClickMessage", "name": "/samples", "instance_index": 7},
        *({"type": "SceneNodeClickMessage", "name": "/samples", **ray} for ray in (hit, missed)),
        {"label": turned, "value": 30.0},
        {"label": "errors ×", "value": 7.0},
        {"label": "uncertainty ×", "value": 3.0},
        {"label": "nominal", "value": False},
        {"label": "sample", "value": 2},
        {"label": "play", "value": True},
    ]
    script = f"<script>listen({json.dumps(asked)}, {json.dumps(arms)});</script>"
    page = tmp_path / "listener.html"
    page.write_bytes(
        b'<meta charset="utf-8"><body>' + ours + LISTENER.encode() + script.encode() + b"</body>"
    )
    run = in_a_browser(page, "--disable-gpu", "--virtual-time-budget=5000", "--dump-dom")
    (found,) = re.findall(r"<pre>(.*?)</pre>", run.stdout)
    told = json.loads(base64.b64decode(found).decode("latin-1"))
    assert told["first"] == [["connected", 0], ["message_batch", len(held.messages)]]
    assert told["played"] == 3

    for each, q, links in zip(drawn, postures, told["poses"], strict=True):
        R, p = each.poses(q)
        np.testing.assert_allclose([link[0] for link in links], R, atol=1e-8)
        np.testing.assert_allclose([link[1] for link in links], p, atol=1e-8)

    clicked, at_ray, nowhere, joint, errors, uncertainty, hidden, chosen, _ = told["answers"]
    arm, rows = scene.arms[0], scene.rows
    assert nowhere == []
    for answer, row in ((clicked, 7), (at_ray, 5), (chosen, 2)):
        R, p = arm.arm.forward(rows.q[row], arm.values)
        node = {"name": "/calibrated/links/tip"}
        np.testing.assert_allclose(only(answer, "SetPosition", **node)["position"], p, atol=1e-7)
        wxyz = only(answer, "SetOrientation", **node)["wxyz"]
        np.testing.assert_allclose(rotation_from_quaternion(np.roll(wxyz, -1)), R, atol=1e-7)
        label = only(answer, "SceneNodeUpdate", name="/name of the sample")
        assert label["updates"]["text"] == rows.names[row]
    sliders = {m["props"]["label"]: m["uuid"] for m in held.messages if "Slider" in m["type"]}
    assert only(clicked, "GuiUpdate", uuid=sliders["sample"])["updates"]["value"] == 7
    degrees = only(clicked, "GuiUpdate", uuid=sliders[turned])["updates"]["value"]
    assert degrees == pytest.approx(np.degrees(rows.q[7, 1]), abs=0.0051)
    q = rows.q[5].copy()
    q[1] = np.radians(30.0)
    tip = only(joint, "SetPosition", name="/calibrated/links/tip")["position"]
    np.testing.assert_allclose(tip, arm.arm.forward(q, arm.values)[1], atol=1e-7)
    bones = only(joint, "SceneNodeUpdate", name="/calibrated/chain")["updates"]["points"]
    _, links = arm.poses(q)
    np.testing.assert_allclose(np.reshape(bones, (-1, 2, 3)), links[arm.bones], atol=1e-6)
    for thing in scene.things:
        if isinstance(thing, Arrows):
            points = only(errors, "SceneNodeUpdate", name=f"/{thing.name}")["updates"]["points"]
            np.testing.assert_allclose(np.reshape(points, (-1, 2, 3)), thing.ends(7.0), atol=1e-6)
        if isinstance(thing, Ellipsoids):
            scales = only(uncertainty, "SceneNodeUpdate", name=f"/{thing.name}")["updates"]
            expected = np.maximum(3.0 * thing.std, 1e-6)
            np.testing.assert_allclose(
                np.reshape(scales["batched_scales"], (-1, 3)), expected, atol=1e-8
            )
    assert only(hidden, "SetSceneNodeVisibility", name="/nominal")["visible"] is False


def only(answer: list[dict[str, Any]], kind: str, **of: str) -> dict[str, Any]:
    (found,) = (m for m in answer if m["type"] == f"{kind}Message" and of.items() <= m.items())
    return found


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to look with")
def test_a_browser_without_a_network_shows_it(html: bytes, tmp_path: Path) -> None:
    file, picture = tmp_path / "page.html", tmp_path / "page.png"
    file.write_bytes(html)
    run = in_a_browser(
        file,
        *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"),
        *("--window-size=900,600", "--virtual-time-budget=1000", f"--screenshot={picture}"),
    )
    assert "Uncaught" not in run.stderr
    pixels = imread(picture)[..., :3]
    scene, panel = pixels[120:480, 160:560], pixels[:, 580:]
    colourful = np.ptp(scene, axis=2) > 0.2  # Arrows and bones; page and floor are grey.
    assert colourful.mean() > 0.002
    # Sliders and ticked boxes, in the panel's blue.
    blue = (panel[..., 2] - panel[..., 0] > 0.4).mean()
    assert blue > 0.001
