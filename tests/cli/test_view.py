"""``suta-calib view``: a job, a result, a device; good and bad input."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import Capture, answer, cli, made_worse, printed, refused, spoken, write_simulated_job
from simulated import SUTA_URDF
from swinging_arm import emulated
from viser_page import held_by

from suta_calib.device import read_device
from suta_calib.emulation import EmulatedArm, Faults
from suta_calib.emulation.faults import Flag, Window
from suta_calib.errors import InputError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.tracking.read_back import read_calibrated
from suta_calib.tracking.viewing import LiveArm
from suta_calib.view.calibration import view_calibration
from suta_calib.view.server import EACH_S

pytest.importorskip("viser")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write_simulated_job(tmp_path_factory.mktemp("view"), SUTA_URDF)
    assert cli("calibrate", path, "--json") == 0
    return path


@pytest.fixture
def result(job: Path) -> Path:
    return job.parent / "results" / "result.json"


def test_a_job_becomes_one_file(job: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    said = printed("view", job, "--html", page)
    assert f"Written: {page}" in said
    assert "mm RMS" in said
    assert max(time for time, _ in held_by(page.read_bytes()).messages) == 54 * EACH_S
    assert [*tmp_path.iterdir()] == [page]


def test_a_result_is_what_the_job_gave(job: Path, result: Path, tmp_path: Path) -> None:
    made, read = CalibrationJob.load(job).run().calibrated, read_calibrated(result)
    for name in made.arm.parameters:
        assert read.values.get(name) == pytest.approx(made.values.get(name))
    assert read.names == made.names
    np.testing.assert_allclose(read.covariance, made.covariance, rtol=1e-9)
    assert read.summary == made.summary
    assert read.assessment == made.assessment
    for name, terms in made.terms.items():
        for (term, values), (_, again) in zip(terms, read.terms[name], strict=True):
            for own in term.own_parameters:
                assert again[own.name] == pytest.approx(values[own.name], abs=1e-7)
    # The folder of a result is the result.
    found = answer("view", result.parent, "--html", tmp_path / "a.html")
    assert found["samples"] == 55
    assert found["verdict"]["usable"] is True
    assert found["html"] == str(tmp_path / "a.html")


def test_it_is_served_until_the_time_is_over(job: Path) -> None:
    assert "Open http://127.0.0.1:" in printed("view", job, "--port", "0", "--seconds", "0.1")


def test_ctrl_c_ends_it_cleanly(result: Path) -> None:
    command = [sys.executable, "-m", "suta_calib", "view", str(result), "--port", "0", "--json"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as run:
        assert run.stdout is not None
        said = ""
        while not said.endswith("\n}\n"):
            said += run.stdout.readline()
        run.send_signal(signal.SIGINT)
        rest, errors = run.communicate(timeout=120)
    assert json.loads(said)["url"].startswith("http://127.0.0.1:")
    assert (rest, errors, run.returncode) == ("", "", 0)


def test_a_port_that_is_taken_is_named(job: Path, capsys: Capture) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert cli("view", job, "--port", port, "--seconds", "0.1") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert f"127.0.0.1:{port}: found another program that listens there" in captured.err
    assert "choose another with --port" in captured.err


@pytest.mark.parametrize("host", ["no.such.host.invalid", "203.0.113.7"])
def test_a_host_that_is_not_this_computer_is_refused(job: Path, host: str) -> None:
    line = refused("view", job, "--host", host, "--port", "0", "--seconds", "0.1")
    assert f"{host}:0: found " in line
    assert "--host" in line


def test_what_must_not_be_used_is_shown_as_such_and_is_not_read_back(
    tmp_path: Path, capsys: Capture
) -> None:
    job, page = made_worse(write_simulated_job(tmp_path / "job", SUTA_URDF)), tmp_path / "page.html"
    assert "Do not use" in printed("view", job, "--html", page, code=1)
    assert "Do not use" in page.read_text(encoding="utf-8")
    page.unlink()
    assert cli("calibrate", job, "--json") == 1
    capsys.readouterr()
    result = job.parent / "results" / "result.json"
    assert "found a result that must not be used" in refused("view", result, "--html", page)
    assert not page.exists()
    assert cli("view", result, "--html", page, "--anyway") == 1
    assert "Do not use" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda data: data.pop("run"), "found no job from which it was made"),
        (lambda data: data["parameters"].pop("base.x"), "found no value of base.x"),
        (lambda data: data["parameters"]["base.x"].update(value="x"), "base.x: found 'x'"),
        (lambda data: data["run"].update(inputs={"gone.yaml": "0"}), "found no job gone.yaml"),
        (lambda data: data.update(status="not converged"), "found 'not converged'"),
        (lambda data: data.update(parameters=[]), "found no table of parameters"),
    ],
)
def test_a_result_that_tells_too_little_is_refused(result: Path, change: Any, told: str) -> None:
    data = json.loads(result.read_text())
    change(data)
    # In a folder of its own beside the results: there the job is looked for.
    folder = result.parent.parent / "changed"
    folder.mkdir(exist_ok=True)
    (folder / "result.json").write_text(json.dumps(data))
    assert told in refused("view", folder, "--html", folder / "page.html")
    assert not (folder / "page.html").exists()


def test_a_job_that_changed_since_is_not_taken_for_the_one_of_the_result(tmp_path: Path) -> None:
    job = write_simulated_job(tmp_path / "job", SUTA_URDF)
    assert cli("calibrate", job, "--json") == 0
    job.write_text(job.read_text() + "# Something else.\n")
    read_calibrated(job.parent / "results")
    # Results of earlier versions have no copy of it.
    (job.parent / "results" / "inputs.zip").unlink()
    with pytest.raises(InputError, match=r"changed since.*calibrate again"):
        read_calibrated(job.parent / "results")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("gone.yaml",), "gone.yaml"),
        (("gone.json", "--html", "a.html"), "gone.json"),
        (("JOB", "--html", "no/such/folder/a.html"), "found no folder"),
        (("JOB", "--html", "a.html", "--device", "device.yaml"), "found --html with --device"),
        (("JOB", "--device", "gone.yaml"), "gone.yaml"),
        (("JOB", "--port", "99999"), "99999"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    job: Path,
    tmp_path: Path,
    arguments: tuple[str, ...],
    told: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert told in refused("view", *(job if word == "JOB" else word for word in arguments))
    assert not [*tmp_path.iterdir()]


def test_without_the_extra_it_says_how_to_install_it(
    job: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("viser", "yourdfpy"):
        monkeypatch.setitem(sys.modules, name, None)
    assert "pip install 'suta_calib[view]'" in refused("view", job, "--seconds", "0.1")


# ── a device ────────────────────────────────────────────────────────────────────────────────
def test_the_arm_moves_as_the_device_reads(result: Path, device: Path) -> None:
    calibrated = read_calibrated(result)
    with view_calibration(calibrated) as viewer:
        live = LiveArm(viewer, calibrated, read_device(device))
        live.follow(lambda: live.shown >= 5, lambda _: None)
        tip = viewer.server.scene.get_handle_by_name("/calibrated/links/tip").position
        said = viewer.server.scene.get_handle_by_name("/tip_is")
        (shown,) = viewer.server.scene.get_handle_by_name("/tip").batched_positions
    # Where the picture has the tip is what the label says, and what the ellipsoid is about.
    np.testing.assert_allclose(shown, tip, atol=1e-6)
    numbers = [float(part.split(" ± ")[0]) for part in said.text.removesuffix(" mm").split(", ")]
    np.testing.assert_allclose(numbers, 1e3 * np.array(tip), atol=6e-3)
    there, _ = calibrated.tip(calibrated.arm, viewer.scene.q[None])
    assert not np.allclose(tip, there[0], atol=1e-3)


def test_an_encoder_that_is_wrong_stops_the_picture(result: Path, tmp_path: Path) -> None:
    calibrated = read_calibrated(result)
    wrong = Faults(errors=(Flag("joint_3", Window(0.0, 1e6)),))
    with EmulatedArm(emulated(faults=wrong)) as emulator, view_calibration(calibrated) as viewer:
        spec = read_device(emulator.write_device(tmp_path / "device.yaml"))
        live = LiveArm(viewer, calibrated, spec)
        before = viewer.server.scene.get_handle_by_name("/calibrated/links/tip").position
        live.follow(
            lambda: viewer.server.scene.get_handle_by_name("/tip_is") is not None, lambda _: None
        )
        after = viewer.server.scene.get_handle_by_name("/calibrated/links/tip").position
        said = viewer.server.scene.get_handle_by_name("/tip_is").text
    assert said == "not valid: error flag of joint_3"
    assert live.shown == 0
    np.testing.assert_array_equal(before, after)


def test_the_command_follows_a_device(result: Path, device: Path, capsys: Capture) -> None:
    assert cli("view", result, "--device", device, "--port", "0", "--seconds", "0.5") == 0
    assert "Open http" in capsys.readouterr().out


def test_a_device_of_another_arm_is_refused(result: Path, tmp_path: Path) -> None:
    other = tmp_path / "device.yaml"
    other.write_text("port: loop://\njoints: [{name: elbow}]\n")
    asked = ("view", result, "--device", other, "--port", "0", "--seconds", "0.5")
    code, _, err = spoken(*asked)
    assert (code, "elbow" in err) == (2, True)


def test_an_answer_that_is_no_calibration_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text('{"tip_mm": [1, 2, 3], "run": {"inputs": {"poses.csv": "0"}}}')
    with pytest.raises(InputError, match="found a result that is not a calibration of an arm"):
        read_calibrated(file)
