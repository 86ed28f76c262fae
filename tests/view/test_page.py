"""One file that opens offline: what is in it, and that a browser shows it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
from cli_job import write_simulated_job
from matplotlib.image import imread
from simulated import SUTA_URDF
from viser_page import Recording, recording_of

from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.job.calibration import CalibrationJob, CalibrationResult
from suta_calib.view.calibration import calibration_scene, show
from suta_calib.view.scene import Arrows, Ellipsoids, Scene
from suta_calib.view.server import Viewer, page

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
def recording(html: bytes) -> Recording:
    return recording_of(html)


def test_it_needs_no_network_and_says_whether_to_use_it(html: bytes, scene: Scene) -> None:
    text = html.decode()
    assert not re.findall(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//[^"'\s>]+""", text)
    assert scene.assessment is not None
    assert scene.assessment.sentence in text
    assert f"errors × {scene.magnification:g}" in text
    assert scene.summary in text
    assert len(html) < 2e6


def test_links_are_where_kinematics_has_them(
    recording: Recording, scene: Scene, result: CalibrationResult
) -> None:
    arm, values = result.job.arm, result.solution.values
    count = len(scene.rows)
    for row in (0, count // 2, count - 1):
        until = 0.25 * row
        node = "/calibrated/links/tip"
        R, p = arm.forward(scene.rows.q[row], values)
        found = recording.last("SetPositionMessage", node, until)["position"]
        np.testing.assert_allclose(found, p, atol=1e-6)
        wxyz = recording.last("SetOrientationMessage", node, until)["wxyz"]
        turned = rotation_from_quaternion(np.roll(wxyz, -1))
        np.testing.assert_allclose(turned, R, atol=1e-6)
    assert recording.seconds == pytest.approx(0.25 * count)


def test_arrows_are_as_long_as_errors_times_the_factor(recording: Recording, scene: Scene) -> None:
    drawn = recording.made("ArrowMessage")
    told = {t.name: t for t in scene.things if isinstance(t, Arrows)}
    assert {name.lstrip("/") for name in drawn} == set(told)
    for name, props in drawn.items():
        begin, end = np.moveaxis(props["points"].reshape(-1, 2, 3), 1, 0)
        errors = np.linalg.norm(told[name.lstrip("/")].vector, axis=1)
        lengths = np.linalg.norm(end - begin, axis=1)
        np.testing.assert_allclose(lengths, scene.magnification * errors, atol=2e-6)


def test_ellipsoids_are_as_wide_as_the_uncertainty_times_the_factor(
    recording: Recording, scene: Scene
) -> None:
    (told,) = (t for t in scene.things if isinstance(t, Ellipsoids))
    props = recording.made("BatchedMeshesMessage")["/uncertainty"]
    scales = props["batched_scales"].reshape(-1, 3)
    np.testing.assert_allclose(scales, np.maximum(scene.inflation * told.std, 1e-6), rtol=1e-5)
    assert np.abs(np.linalg.norm(props["vertices"].reshape(-1, 3), axis=1) - 1).max() < 1e-6


def test_every_sample_is_named(recording: Recording, scene: Scene) -> None:
    names = [
        m["updates"]["text"]
        for _, m in recording.messages
        if m["type"] == "SceneNodeUpdateMessage" and "text" in m["updates"]
    ]
    assert set(scene.rows.names[1:]) <= set(names)


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
        # A slider in degrees moves the arm in radians.
        viewer.joints[1].value = 30.0
        q = scene.q.copy()
        q[1] = np.radians(30.0)
        np.testing.assert_allclose(tip.position, arm.arm.forward(q, arm.values)[1], atol=1e-4)


def test_a_result_shows_itself_and_so_does_any_solution(result: CalibrationResult) -> None:
    with result.view() as viewer, show(result.solution, result.accuracy) as other:
        assert f'src="{viewer.url}"' in viewer._repr_html_()
        with urlopen(viewer.url) as answer:
            assert b"<html" in answer.read()[:2000]
        assert viewer.url != other.url
        assert other.scene.summary == viewer.scene.summary
        assert viewer.scene.title.endswith("calibration.yaml")
        assert other.scene.title == "arm.urdf"


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to look with")
def test_a_browser_without_a_network_shows_it(html: bytes, tmp_path: Path) -> None:
    file, picture = tmp_path / "page.html", tmp_path / "page.png"
    file.write_bytes(html)
    options = (
        *("--headless=new", "--no-sandbox", "--no-first-run", "--hide-scrollbars"),
        *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
        *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"),
        *("--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}"),
        *("--window-size=640,480", "--virtual-time-budget=3000", f"--screenshot={picture}"),
    )
    run = subprocess.run(
        [str(CHROMIUM), *options, file.as_uri()], capture_output=True, text=True, check=False
    )
    assert "Embedded data loaded" in run.stderr
    assert "Uncaught" not in run.stderr
    pixels = imread(picture)[..., :3]
    middle = pixels[120:360, 160:480]
    colourful = np.ptp(middle, axis=2) > 0.2  # Arrows and bones; page and floor are grey.
    assert colourful.mean() > 0.002
