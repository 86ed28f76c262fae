"""A line scanner on the hand: found with a true ±; scans that are wrong are named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import answer, cli
from line_scans import BALL, LineScans, X, line_scans

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import quaternion_from_rotation, vector_from_rotation
from suta_calib.measurements.profiles import profiles_of, write_profiles
from suta_calib.pose_calibration import LineScannerCalibration, calibrate_line_scanner


def solved(scans: LineScans, **options: Any) -> LineScannerCalibration:
    options = options or {"radius": 0.02}
    hand = scans.rotation, scans.position
    return calibrate_line_scanner(hand, scans.scans, scans.profiles, **options)


def off(found: LineScannerCalibration) -> np.ndarray:
    """Errors (6,) in units of the standard deviations."""
    turn = vector_from_rotation(X[0].T @ found.X[:3, :3])
    return np.asarray(np.concatenate([found.X[:3, 3] - X[1], turn]) / found.std)


@pytest.mark.parametrize(
    ("scanned", "options"),
    [
        ({"radius": 0.02}, {"radius": 0.02}),
        ({"radius": 0.04, "hand": 1e-6}, {"radius": None}),
        ({"radius": None}, {"plane": True}),
    ],
)
def test_it_is_found_within_what_it_says(scanned: Any, options: Any) -> None:
    errors = [off(solved(line_scans(seed, **scanned), **options)) for seed in range(4)]
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_what_the_ball_is_and_what_the_hand_errs_by() -> None:
    found = solved(line_scans(1, count=30), radius=None)
    assert found.radius == pytest.approx(0.02, abs=5 * found.radius_std)
    assert np.all(np.abs(found.place - BALL) < 5 * found.place_std)
    assert found.hand_noise == pytest.approx(2.6e-4, rel=0.3)
    assert found.assessment.level == "good"


def test_a_point_of_a_profile_in_the_base_with_its_std() -> None:
    scans = line_scans(2)
    found = solved(scans)
    hand = np.eye(4)
    hand[:3, :3], hand[:3, 3] = scans.rotation[0], scans.position[0]
    points = np.array([[0.0, 0.15], [0.03, 0.16]])
    place, std = found.in_base(hand, points)
    true = np.insert(points, 1, 0.0, axis=1) @ X[0].T + X[1]
    assert np.all(np.abs(place - (true @ hand[:3, :3].T + hand[:3, 3])) < 4 * std)
    assert np.all(std < 1e-3)


def test_scans_that_are_turned_or_exchanged_are_named() -> None:
    scans = line_scans(3)
    by_scan = scans.profiles.by_scan()
    turned = replace(scans, profiles=scans.changed("s4", by_scan["s4"][::-1] * [-1.0, 1.0]))
    found = solved(turned)
    assert [found.scans[k] for k in found.outliers] == ["s4"]
    (note,) = found.assessment.notes
    assert note.startswith("Scan s4 fits the others with x reversed")
    names = np.array(scans.profiles.scan)
    exchanged = names.copy()
    exchanged[names == "s2"], exchanged[names == "s9"] = "s9", "s2"
    found = solved(replace(scans, profiles=profiles_of(exchanged, scans.profiles.point)))
    (note,) = found.assessment.notes
    assert note.startswith("Scans s2, s9 fit the others if the two are exchanged")


@pytest.mark.parametrize("seed", [2, 4])
def test_of_many_turned_scans_none_is_followed(seed: int) -> None:
    """A ball near the beam fits both ways at first: the others tell it, or it means little."""
    scans = line_scans(seed, count=20)
    points, profiles = scans.profiles.by_scan(), scans
    for name in scans.scans[11:]:
        profiles = replace(profiles, profiles=profiles.changed(name, points[name] * [-1.0, 1.0]))
    found = solved(profiles)
    assert np.sum(found.inliers[11:]) <= 1
    assert found.inliers[:11].all()
    assert np.all(np.abs(off(found)) < 4.5)
    assert found.assessment.level in ("care", "bad")
    assert any("with x reversed" in note for note in found.assessment.notes)


def test_a_hollow_and_too_few_points_are_left_out_with_a_word() -> None:
    scans = line_scans(4)
    points = scans.profiles.by_scan()
    less = replace(scans, profiles=scans.changed("s5", points["s5"][::25]))
    assert (
        "no ball of 1 of 16 scans (s5): they are left out (a ball needs 12 points"
        in solved(less).notes[0]
    )
    hollow = replace(scans, profiles=scans.changed("s6", points["s6"] * [1.0, -1.0]))
    assert "(s6) a hollow where the others have a ball" in solved(hollow).notes[0]


def test_another_radius_than_is_said_is_named() -> None:
    found = solved(line_scans(5), radius=0.04)
    assert found.assessment.level == "bad"
    assert "sphere_radius_mm is 40, but the scans fit a ball of 20.0" in found.assessment.notes[0]
    assert "Is it the diameter?" in found.assessment.notes[0]


def test_scans_that_leave_the_scanner_open_are_refused() -> None:
    with pytest.raises(SamplesError, match="do not determine X"):
        solved(line_scans(6, tilt=1e-4))
    with pytest.raises(SamplesError, match="3 scans that show the ball; expected at least 4"):
        solved(line_scans(6, count=3))


def test_the_command_writes_what_the_answer_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = line_scans(7)
    write_profiles(tmp_path / "profiles.csv", scans.profiles)
    quaternion = quaternion_from_rotation(scans.rotation)
    rows = [
        ",".join([name, *map(repr, [*p.tolist(), *q.tolist()])])
        for name, p, q in zip(scans.scans, scans.position, quaternion, strict=True)
    ]
    (tmp_path / "poses.csv").write_text("\n".join(["scan,x,y,z,qx,qy,qz,qw", *rows]) + "\n")
    files = tmp_path / "poses.csv", "--profiles", tmp_path / "profiles.csv"
    found = answer("hand-eye", *files, "--sphere-radius-mm", 20, "--out", tmp_path / "out")
    assert found["verdict"]["level"] == "good"
    assert np.linalg.norm(np.array(found["X"])[:3, 3] - X[1]) < 2e-3
    assert len(found["spread_mm"]) == 3
    assert found["counts"] == {"rows": 16, "inliers": 16, "outliers": 0}
    assert json.loads((tmp_path / "out" / "result.json").read_text())["rms_mm"] < 0.6
    assert cli("hand-eye", *files, "--plane", "--sphere-radius-mm", 20) == 2
    assert "not both" in capsys.readouterr().err
    assert cli("hand-eye", tmp_path / "poses.csv", "--plane") == 2
    assert "need --profiles" in capsys.readouterr().err


def test_measured_profiles_of_a_ball_of_unknown_size(shared: Path) -> None:
    folder = shared / "scanner_ball"
    found = answer("hand-eye", folder / "poses.csv", "--profiles", folder / "profiles.csv")
    assert found["outliers"] == []
    assert found["rms_mm"] < 0.7
    assert found["sphere_radius_mm"] == pytest.approx(12.1, abs=0.4)
