"""The tip's uncertainty: derivative, registration, Monte-Carlo, and the map over the workspace."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli, write_simulated_job
from matplotlib.figure import Figure
from simulated import arm_named, dh_parameters, perturbed, random_readings

from suta_calib.analysis.planning import Region
from suta_calib.analysis.tip_map import Figures, TipMapOptions, tip_map, tip_map_of_result
from suta_calib.analysis.tip_sections import Knowledge
from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import register_points, rotation_from_vector, skew
from suta_calib.trust.tip import Sensitivity, sensitivity

ARM = arm_named("suta")
TRUTH = perturbed(dh_parameters(ARM), 1)
NAMES = dh_parameters(ARM).names
DOWN = np.array([0.0, 0.0, -1.0])
# A coarse map is drawn sooner.
FAST = ("--grid", 15)


def at(seed: int, n: int = 25) -> Sensitivity:
    """The tip in random postures."""
    return sensitivity(ARM, TRUTH, NAMES, random_readings(ARM, np.random.default_rng(seed), n))


def test_the_derivative_is_that_of_central_differences() -> None:
    found, step = at(0), 1e-6
    for k, name in enumerate(NAMES):
        up, down = ({**TRUTH, name: TRUTH[name] + s} for s in (step, -step))
        difference = (ARM.forward(found.q, up)[1] - ARM.forward(found.q, down)[1]) / (2 * step)
        np.testing.assert_allclose(found.jacobian[:, :, k], difference, atol=1e-8)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_registration_takes_out_whatever_moves_the_whole_arm(elsewhere: bool) -> None:
    found, reference = at(0), at(1) if elsewhere else None
    left = found.registered(reference)
    for gauge in ("joint_1.offset", "joint_2.z"):
        assert np.abs(left[:, :, NAMES.index(gauge)]).max() < 1e-12
    assert np.abs(left[:, :, NAMES.index("joint_4.z")]).max() > 1e-2


def test_what_registered_points_in_a_line_leave_open_is_not_taken_out() -> None:
    line = np.outer(np.linspace(-0.1, 0.1, 5), [1.0, 0.0, 0.0]) + np.array([0.5, 0.1, 0.2])
    turn = np.array([1.0, 0.0, 0.0])

    def turning(position: FloatArray) -> Sensitivity:
        jacobian = (-skew(position - line[2]) @ turn)[:, :, None]
        return Sensitivity(np.zeros((len(position), 6)), position, np.zeros(()), jacobian)

    away = turning(line + np.array([0.0, 0.3, 0.0]))
    np.testing.assert_allclose(away.registered(turning(line)), away.jacobian, atol=1e-12)


def test_predictions_are_the_scatter_of_drawn_arms() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((13, 13)) * dh_parameters(ARM).array("plausible") / 100
    covariance = root.T @ root / 13
    draws = rng.multivariate_normal(np.zeros(13), covariance, 400)
    inside, reference = at(0, 10), at(1, 8)
    absolute, registered = [], []
    for draw in draws:
        values = {n: TRUTH[n] + d for n, d in zip(NAMES, draw, strict=True)}
        tip, touched = (ARM.forward(each.q, values)[1] for each in (inside, reference))
        R, p = register_points(touched, reference.position)
        absolute.append(tip - inside.position)
        registered.append(tip @ R.T + p - inside.position)
    for scatter, jacobian in ((absolute, None), (registered, inside.registered(reference))):
        found = np.sqrt(np.mean(np.sum(np.array(scatter) ** 2, axis=2), axis=0))
        np.testing.assert_allclose(found, inside.std(covariance, jacobian), rtol=0.12)


def knowledge() -> Knowledge:
    """An arm with 1 mm of error in each length it knows."""
    lengths = tuple(n for n in NAMES if not n.endswith("offset"))
    visited = np.array([[0.26, 3.05, 2.79, 1.92, -1.57, -2.18]])
    fixed = (("tip.y", {"tip.y": 1.0}, 0.01), ("joint_1.offset", {"joint_1.offset": 1.0}, 0.2))
    return Knowledge(ARM, {}, lengths, 1e-6 * np.eye(len(lengths)), ("tip.y",), visited, fixed)


def test_the_map_knows_where_the_arm_reaches_and_what_is_open() -> None:
    known = knowledge()
    region = Region(np.array([0.3, -0.2, 0.0]), np.array([0.6, 0.2, 0.3]), DOWN)
    tips = ARM.forward(known.visited)[1]
    postures = region.postures(known.kinematics, known.visited, tips, 0)
    corners = 0.08 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 1]])
    place = np.array([0.45, 0.0, 0.05])
    found = tip_map(known, region, place, corners, postures, grid=13)
    assert found.registration == 4
    for each in found.sections:
        out = np.isnan(each.registered)
        assert 0 < out.mean() < 1
        np.testing.assert_array_equal(out, np.isnan(each.absolute))
        assert out[0, 0]
    effects = {each.fixed: each.effect for each in found.open_directions}
    assert effects["joint_1.offset"] < 1e-9 < 1e-3 < effects["tip.y"]
    assert found.registered.rms < found.absolute.rms
    with pytest.raises(JobError, match="registration points within reach"):
        tip_map(known, region, np.array([3.0, 0, 0]), corners, postures, grid=5)


def test_a_region_out_of_reach_or_without_volume_is_refused() -> None:
    known = knowledge()
    far = Region(np.array([3.0, 3.0, 3.0]), np.array([4.0, 4.0, 4.0]), DOWN)
    with pytest.raises(JobError, match="0 of 240 postures within reach"):
        far.postures(known.kinematics, known.visited, ARM.forward(known.visited)[1], 0)
    with pytest.raises(JobError, match="a lower corner that is below"):
        Region(np.zeros(3), np.array([1.0, 0.0, 1.0]), DOWN)


def test_a_map_says_whether_it_is_good_enough() -> None:
    known = knowledge()
    box = np.array([[0.15, -0.3, 0.0], [0.6, 0.3, 0.4]])
    found = tip_map_of_result(known, TipMapOptions(box, tolerance=1e-6, grid=7))
    assert found.assessment.level == "bad"
    assert found.assessment.notes[0] == "This exceeds the allowed 0.001 mm."
    enough = replace(found, tolerance=1.0).assessment
    assert enough.usable
    assert any(
        note.startswith("tip.y is held at an assumed value, not measured") for note in enough.notes
    )
    figure = found.plot(Figure())
    for axes, section in zip(figure.axes, found.sections, strict=False):
        arm = next(line for line in axes.lines if line.get_label() == "arm")
        wanted = 1e3 * section.project(found.drawn)
        np.testing.assert_allclose(np.array(arm.get_data()).T, wanted, atol=1e-9)
    assert found.assessment.sentence in repr(found)
    assert "Uncertainty of the tip" in found._repr_html_()
    with pytest.raises(JobError, match="the region of the tip"):
        tip_map_of_result(known, TipMapOptions())


def test_figures() -> None:
    found = Figures.of(np.array([0.1e-3, 0.4e-3, 0.7e-3]))
    assert found.within == (pytest.approx(1 / 3), pytest.approx(2 / 3))
    assert found.rms == pytest.approx(1e-3 * np.sqrt((0.01 + 0.16 + 0.49) / 3))


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """A simulated job whose instrument sees the tip."""
    return write_simulated_job(tmp_path_factory.mktemp("tip_map"), suta_urdf)


def test_the_command_writes_a_map(job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    box = "150,600,-300,300,0,400"
    assert cli("tip-map", job, "--json", "--region", box, "--register-at", "400,0,150", *FAST) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["registered"]["rms_mm"] > 0
    assert {"side", "top"} == set(told["sections"])
    assert [row["value_mm"] for row in told["field"]] == [0.3, 0.48, 0.024]
    folder = job.parent / "results"
    assert set(told["files"]) == {"tip_map.svg", "report.html", "tip_map.json"}
    assert "NaN" not in (folder / "tip_map.json").read_text()
    assert cli("tip-map", job, "--region", box, "--tolerance-mm", 1e-3, *FAST) == 1
    assert "exceeds the allowed 0.001 mm" in capsys.readouterr().out


def test_the_command_reads_a_result(job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli("calibrate", job) == 0
    capsys.readouterr()
    result, urdf = job.parent / "results" / "result.json", job.parent / "arm.urdf"
    options = (
        "--urdf",
        urdf,
        "--tip",
        "tip",
        "--region",
        "150,600,-300,300,0,400",
        "--json",
        *FAST,
    )
    assert cli("tip-map", result, *options) == 0
    cool = json.loads(capsys.readouterr().out)
    assert cool["absolute"]["rms_mm"] > 0
    assert not any("temperature of the arm" in note for note in cool["verdict"]["notes"])
    # What is held is not forgotten on the way.
    written = json.loads(result.read_text())
    assert [each["parameter"] for each in written["held"]] == written["unidentified"]
    assert not any("held" in note for note in cool["verdict"]["notes"])
    name = written["covariance"]["parameters"][-1]
    written["parameters"][name] |= {"std": None, "state": "unidentified"}
    for table in ("covariance", "correlations"):
        del written[table]
    written["unidentified"].append(name)
    held = {"parameter": name, "plausible": 0.03, "direction": {name: 1.0}}
    for kept, said in (
        ([*written["held"], held], f"{name} is held at an assumed value, not measured,"),
        ([], f"{name}. The result does not contain their effect"),
    ):
        other = result.with_name("held.json")
        other.write_text(json.dumps(written | {"held": kept}))
        assert cli("tip-map", other, *options, "--grid", 5) == 0
        verdict = json.loads(capsys.readouterr().out)["verdict"]
        assert verdict["level"] == "care"
        assert any(said in note for note in verdict["notes"])
    # What was found of its lengths says nothing of how warm it is.
    written = json.loads(result.read_text())
    written["parameters"]["links.expansion"] = {"value": 23e-6, "std": None, "state": "fixed"}
    result.write_text(json.dumps(written))
    assert cli("tip-map", result, *options, "--grid", 5) == 0
    notes = json.loads(capsys.readouterr().out)["verdict"]["notes"]
    (note,) = (each for each in notes if "temperature of the arm" in each)
    assert "taken to be 20 °C, though links.expansion was estimated" in note


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--region", "1,2,3"), "expected X0,X1,Y0,Y1,Z0,Z1 in mm"),
        (("--region", "1,2,3,4,5,nan"), "expected X0,X1,Y0,Y1,Z0,Z1 in mm"),
        (("--region", "9000,9100,0,1,0,1"), "0 of 240 postures within reach"),
        (("--register-at", "9000,0,0"), "registration points within reach"),
        (("--tolerance-mm", "nan"), "expected a finite number"),
        (("--tip", "tip"), "needs --urdf and --tip"),
    ],
)
def test_bad_options_are_one_line(
    job: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, str],
    said: str,
) -> None:
    assert cli("tip-map", job, "--out", tmp_path / "out", *options) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_rotations_fill_the_cone_evenly() -> None:
    from suta_calib.analysis.planning.region import directions, mean_axis

    u = (np.arange(4000) + 0.5) / 4000
    axis = rotation_from_vector([0.3, -0.7, 0.2])[:, 2]
    z = directions(axis, 0.8, u, (u * 997) % 1)[:, :, 2]
    cosine = z @ axis
    assert cosine.min() >= np.cos(0.8)
    assert np.mean(cosine) == pytest.approx((1 + np.cos(0.8)) / 2, rel=1e-3)
    np.testing.assert_allclose(mean_axis(directions(axis, 0.8, u, (u * 997) % 1)), axis, atol=1e-3)
