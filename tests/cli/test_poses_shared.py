"""What the commands on poses have in common: the screen, examples, measured sets."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, printed, refused
from pose_answers import XYZ, within
from pose_scenes import PAIR, POSE, TIP, pair_numbers, pivot_numbers, point_numbers, write_csv
from rich.console import Console
from scipy.spatial.transform import Rotation

from suta_calib.cli import _output


# ── all three ────────────────────────────────────────────────────────────────────────────────
def test_the_screen_fits_eighty_columns(
    pivot_file: Path,
    point_files: tuple[Path, Path],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    pairs = write_csv(tmp_path / "pairs.csv", PAIR, pair_numbers(20, "eye-in-hand"))
    for arguments, says in (
        (
            ("pivot", pivot_file),
            ("Tip in the tool, post in the tracker", "rows 6 (line 8), 21 (line 23)", "Good."),
        ),
        (("hand-eye", pairs, "--model", "AX=ZB"), ("X = T_hand_eye", "Z = T_base_target")),
        (("register", *point_files, "--target", point_files[0]), ("T_b_a", "row 4 (line 6)")),
    ):
        assert cli(*arguments) == 0
        out, err = capsys.readouterr()
        assert err == ""
        assert max(map(len, out.splitlines())) <= 80
        for words in (*says, "rms", "fitted"):
            assert words in out


def test_files_named_on_the_screen(pivot_file: Path, tmp_path: Path) -> None:
    said = printed("pivot", pivot_file, "--out", tmp_path / "out").splitlines()
    files = "residuals.csv, pivot.svg, tip.json, report.html, result.json"
    assert f"Written to {tmp_path / 'out'}: {files}" in said


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize(("patience", "said"), [(0.0, True), (60.0, False)])
def test_long_work_says_so(
    terminal: bool, patience: float, said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = io.StringIO()
    there = Console(file=written, force_terminal=terminal)
    monkeypatch.setattr(_output, "console", lambda **_: there)
    status = _output.LateProgress("calibrating", patience)
    status(3, 7)
    with status:
        for _ in range(100):
            if "calibrating" in written.getvalue():
                break
            time.sleep(0.01 if said else 0.001)
    status.__exit__(None, None, None)
    assert ("calibrating" in written.getvalue()) == said
    if said and not terminal:
        assert written.getvalue() == "calibrating: 3 of 7, 0 s so far\n"


@pytest.mark.filterwarnings("default")
def test_a_warning_does_not_spoil_json(tmp_path: Path, capsys: Capture) -> None:
    numbers = pivot_numbers(["left"] * 20)
    numbers[3, 3:] *= 1.5
    assert cli("pivot", write_csv(tmp_path / "p.csv", POSE, numbers), "--json") == 0
    out, err = capsys.readouterr()
    within((found := json.loads(out))["tip_mm"], 1e3 * TIP, found["tip_std_mm"])
    assert err.startswith("suta-calib: warning: ")
    assert "quaternion of length 1.500" in err


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("command", ["pivot", "hand-eye", "register"])
def test_an_evident_unit_is_in_the_verdict(command: str, tmp_path: Path, capsys: Capture) -> None:
    """Millimetres under the names of metres: the answer is a thousand times too large."""
    pairs = pair_numbers(15, "eye-in-hand")
    pairs[:, [0, 1, 2, 7, 8, 9]] *= 1e3
    touches = pivot_numbers(["left"] * 20)
    touches[:, :3] *= 1e3
    files = {
        "pivot": [write_csv(tmp_path / "p.csv", POSE, touches)],
        "hand-eye": [write_csv(tmp_path / "h.csv", PAIR, pairs)],
        "register": [
            write_csv(tmp_path / f"{name}.csv", XYZ, 1e3 * points)
            for name, points in zip("ab", point_numbers(12), strict=True)
        ],
    }[command]
    assert cli(command, *files, "--json") == 1
    out, err = capsys.readouterr()
    assessment = json.loads(out)["verdict"]
    assert assessment["level"] == "bad"
    assert "in mm? Then name the columns x_mm" in assessment["notes"][0]
    notes = [note for note in assessment["notes"] if "looks like millimetres" in note]
    assert len(notes) == (1 if command == "pivot" else 2)
    assert err.count("looks like millimetres") == len(notes)
    assert f"{files[0]}:1: column" in notes[0]
    shown = " ".join(printed(command, *files, code=1).split())
    assert "Do not use" in shown
    assert shown.count("looks like millimetres") == len(notes)


@pytest.mark.parametrize("given", ["other setup", "w x y z"])
def test_misread_pairs_are_one_line(given: str, tmp_path: Path, capsys: Capture) -> None:
    numbers = pair_numbers(15, "eye-in-hand")
    if given == "w x y z":
        numbers[:, 3:7] = np.roll(numbers[:, 3:7], 1, axis=1)
    file = write_csv(tmp_path / "h.csv", PAIR, numbers)
    setup = "eye-to-hand" if given == "other setup" else "eye-in-hand"
    assert cli("hand-eye", file, "--setup", setup, "--out", tmp_path / "out") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    says = "if setup is eye-in-hand" if given == "other setup" else "hand's quaternions are in the"
    assert "do not agree with any X" in err
    assert says in err
    assert not (tmp_path / "out").exists()


def test_the_shipped_examples(repository: Path) -> None:
    folder = repository / "data" / "poses"
    one = answer("pivot", folder / "pivot.csv")
    within(one["tip_mm"], [-14.3, 2.1, 158.7], one["tip_std_mm"])
    assert one["outliers"] == [7, 23, 41]
    two = answer("pivot", folder / "pivot_two_posts.csv")
    within(two["posts_mm"]["P2"], [20, 90, -1470], two["posts_std_mm"]["P2"])
    assert two["outliers"] == [5, 52]
    eye = answer("hand-eye", folder / "hand_eye.csv")
    std = eye["std"]["X"]
    within(eye["X_position_mm"], [31, -62, 94], [std[f"{axis}_mm"] for axis in "xyz"])
    assert eye["outliers"] == [4, 17]
    moved = answer("register", folder / "register_a.csv", folder / "register_b.csv")
    std = moved["std"]
    within(moved["position_mm"], [250, -400, 1100], [std[f"{axis}_mm"] for axis in "xyz"])
    assert moved["outliers"] == [8]


# ── measured sets ────────────────────────────────────────────────────────────────────────────
def test_measured_pointer(shared: Path) -> None:
    path = shared / "poses" / "pivot_sksurgery.csv"
    found = answer("pivot", path, "--no-robust")
    np.testing.assert_allclose(found["tip_mm"], [-14.473, 394.634, -7.407], atol=1e-3)
    assert found["rms_mm"] == pytest.approx(1.761 * np.sqrt(3), rel=1e-3)
    assert found["verdict"]["level"] == "care"
    assert any("turned too little" in note for note in found["verdict"]["notes"])


def test_measured_robot_and_chessboard(shared: Path, tmp_path: Path) -> None:
    path = shared / "poses" / "handeye_kuka_1.csv"
    found = answer("hand-eye", path)
    numbers = np.loadtxt(path, delimiter=",", skiprows=1)
    R, eye = Rotation.from_quat(numbers[:, 3:7]), np.array(found["X"])
    board = numbers[:, 7:10] @ eye[:3, :3].T + eye[:3, 3]
    board = R.apply(board) + numbers[:, :3]
    spread = np.sqrt(np.mean(np.sum((board - board.mean(axis=0)) ** 2, axis=1)))
    assert 1e3 * spread <= 1.75
    translations = write_csv(tmp_path / "five.csv", PAIR, numbers[:5])
    assert "five.csv: found poses that do not determine X" in refused("hand-eye", translations)


def test_course_data(shared: Path) -> None:
    found = answer("hand-eye", shared / "hand_eye_rviz" / "clean.csv")
    expected = [-0.295686, 0.641919, -0.295793, 0.642663]
    np.testing.assert_allclose(found["X_quaternion_xyzw"], expected, atol=2e-3)
    np.testing.assert_allclose(found["X_position_mm"], [13.254, -10.796, -11.528], atol=3.0)
