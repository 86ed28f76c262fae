"""One file that opens offline: what is in it, and that a browser shows it."""

from __future__ import annotations

import re
import shutil
import subprocess
from html import escape
from pathlib import Path
from types import SimpleNamespace
from urllib.request import urlopen

import numpy as np
import pytest
from cli_job import write_simulated_job
from matplotlib.image import imread
from simulated import SUTA_URDF
from viser_page import Held, held_by

from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.job.calibration import Calibration, CalibrationJob
from suta_calib.view.calibration import calibration_scene, show
from suta_calib.view.page import page
from suta_calib.view.scene import ArmScene, Ellipsoids, ErrorVectors
from suta_calib.view.server import EACH_S, Viewer, legend

pytest.importorskip("viser")
NAME = "/name of the sample"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    job = write_simulated_job(tmp_path_factory.mktemp("job"), SUTA_URDF)
    return CalibrationJob.load(job).run()


@pytest.fixture(scope="module")
def scene(result: Calibration) -> ArmScene:
    return calibration_scene(result.calibrated)


@pytest.fixture(scope="module")
def html(scene: ArmScene) -> bytes:
    return page(scene)


@pytest.fixture(scope="module")
def held(html: bytes) -> Held:
    return held_by(html)


def test_it_needs_no_network_and_says_whether_to_use_it(html: bytes, scene: ArmScene) -> None:
    text = html.decode()
    assert not re.findall(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//[^"'\s>]+""", text)
    assert scene.assessment is not None
    assert scene.assessment.statement in text
    assert scene.summary in text
    assert f"errors × {scene.magnification:g}" in text
    assert legend(scene) in text
    for what in ("calibrated arm", "nominal arm", "errors of the validation data", "uncertainty"):
        assert what in legend(scene)
    # As the reader's system has it: light or dark.
    assert '{darkMode:matchMedia("(prefers-color-scheme: dark)").matches}' in text
    (panel,) = re.findall(r'<details id="suta-calib" open><summary>(.*?)</summary>', text)
    assert panel == f"calibration.yaml: {scene.assessment.word}"
    assert all(note in text for note in map(escape, scene.assessment.notes))
    assert f"<title>{scene.title}</title>" in text
    assert len(html) < 2e6


def test_the_page_plays_every_sample_and_names_it(
    held: Held, scene: ArmScene, result: Calibration
) -> None:
    node = "/calibrated/links/tip"
    turns, places = (
        held.told(f"Set{what}Message", node)[-len(scene.rows) :]
        for what in ("Orientation", "Position")
    )
    R, p = result.job.arm.forward(scene.rows.q, result.solution.values)
    np.testing.assert_allclose([time for time, _ in places], EACH_S * np.arange(len(scene.rows)))
    np.testing.assert_allclose([m["position"] for _, m in places], p, atol=1e-6)
    wxyz = np.array([m["wxyz"] for _, m in turns])
    np.testing.assert_allclose(
        [rotation_from_quaternion(np.roll(each, -1)) for each in wxyz], R, atol=1e-6
    )
    names = [m["updates"].get("text") for _, m in held.told("SceneNodeUpdateMessage", NAME)]
    # The first is written when the label is made.
    assert [name for name in names if name][1 - len(scene.rows) :] == list(scene.rows.names[1:])


def test_arrows_are_as_long_as_errors_times_the_factor(held: Held, scene: ArmScene) -> None:
    drawn = held.made("ArrowMessage")
    told = {t.name: t for t in scene.things if isinstance(t, ErrorVectors)}
    assert {name.lstrip("/") for name in drawn} == set(told)
    for name, props in drawn.items():
        begin, end = np.moveaxis(props["points"].reshape(-1, 2, 3), 1, 0)
        errors = np.linalg.norm(told[name.lstrip("/")].vector, axis=1)
        lengths = np.linalg.norm(end - begin, axis=1)
        np.testing.assert_allclose(lengths, scene.magnification * errors, atol=2e-6)


def test_ellipsoids_are_as_wide_as_the_uncertainty_times_the_factor(
    held: Held, scene: ArmScene
) -> None:
    (told,) = (t for t in scene.things if isinstance(t, Ellipsoids))
    props = held.made("BatchedMeshesMessage")["/uncertainty"]
    scales = props["batched_scales"].reshape(-1, 3)
    np.testing.assert_allclose(scales, np.maximum(scene.inflation * told.std, 1e-6), rtol=1e-5)
    assert np.abs(np.linalg.norm(props["vertices"].reshape(-1, 3), axis=1) - 1).max() < 1e-6


def test_factors_joints_and_samples_are_chosen_in_the_panel(scene: ArmScene) -> None:
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


def test_a_result_shows_itself_and_so_does_any_solution(result: Calibration) -> None:
    with result.view() as viewer, show(result.examined) as other:
        assert f'src="{viewer.url}"' in viewer._repr_html_()
        with urlopen(viewer.url) as answer:
            assert b"<html" in answer.read()[:2000]
        assert viewer.url != other.url
        assert other.scene.summary == viewer.scene.summary
        assert viewer.scene.title.endswith("calibration.yaml")
        assert other.scene.title == "arm.urdf"


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


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to look with")
def test_a_browser_without_a_network_shows_it(html: bytes, tmp_path: Path) -> None:
    file, picture = tmp_path / "page.html", tmp_path / "page.png"
    file.write_bytes(html)
    run = in_a_browser(
        file,
        *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"),
        *("--window-size=1400,600", "--virtual-time-budget=1000", f"--screenshot={picture}"),
    )
    assert "Uncaught" not in run.stderr
    pixels = imread(picture)[..., :3]
    scene, panel, bar = pixels[160:520, 400:1000], pixels[:300, 1040:], pixels[560:]
    colourful = np.ptp(scene, axis=2) > 0.2  # Arrows and bones; page and floor are grey.
    assert colourful.mean() > 0.002
    # The panel is filled: letters of the verdict and of the legend, and the legend's colours.
    assert (panel.max(axis=2) < 0.4).mean() > 0.01
    assert (np.ptp(panel, axis=2) > 0.2).mean() > 0.001
    # It plays: what has been played is blue.
    assert (bar[..., 2] - bar[..., 0] > 0.4).mean() > 0.001
