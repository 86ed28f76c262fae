"""Recorded against reference motions, with latency, play and errors that are known (simulated)."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from scipy.spatial.transform import Rotation
from simulated import SUTA_URDF, arm_named
from studies import first_of, of_size
from tracking_scene import with_play

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.tracking.alignment import align
from suta_calib.tracking.path_accuracy import compare
from suta_calib.tracking.reversals import turning_points
from suta_calib.tracking.trajectory import Trajectory, read_trajectory

RATE = 200.0
LATENCY = 0.0123
PLAY = np.radians([0.05, 0.0, 0.1, 0.0, 0.0, 0.2])
FREQUENCY = np.array([0.23, 0.31, 0.37, 0.29, 0.41, 0.53])
PHASE = np.array([0.3, 1.9, 4.0, 2.2, 5.5, 0.9])
MIDDLE = np.array([0.2, 0.3, -0.4, 0.2, 0.5, 0.1])
TURN, SHIFT = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(), np.array([1.0, 2.0, 3.0])
NOWHERE = Path("motion.csv")


def true_angles(time: FloatArray) -> FloatArray:
    return MIDDLE + 0.45 * np.sin(2 * math.pi * FREQUENCY * time[:, None] + PHASE)


def motions(
    latency: float = LATENCY,
    play: FloatArray = PLAY,
    *,
    seconds: float = 15.0,
    geometry: dict[str, float] | None = None,
    noise: float = 2e-6,
) -> tuple[Trajectory, Trajectory]:
    """Recorded and reference."""
    arm, rng = arm_named("suta"), np.random.default_rng(1)
    time = np.arange(0, seconds, 1 / RATE)
    rotation, position = arm.forward(true_angles(time), geometry)
    reference = Trajectory(NOWHERE, time, position, rotation)
    # Play depends on what came before: begin earlier than the record.
    early = np.arange(-2.0, 0.0, 1 / RATE)
    read = with_play(true_angles(np.concatenate([early, time]) - latency), play)[len(early) :]
    read += noise * rng.standard_normal(read.shape)
    rotation, position = arm.forward(read)
    return Trajectory(NOWHERE, time, position, rotation, read), reference


def moved(trajectory: Trajectory) -> Trajectory:
    assert trajectory.rotation is not None
    position = trajectory.position @ TURN.T + SHIFT
    return Trajectory(NOWHERE, trajectory.time, position, TURN @ trajectory.rotation)


@pytest.mark.parametrize("latency", [-0.2, -0.004, 0.0, 0.0123, 0.35])
def test_latency_is_found(latency: float):
    found = align(*motions(latency, 0 * PLAY))
    assert found.latency == pytest.approx(latency, abs=2e-6)
    assert 0 < found.latency_std < 2e-6
    assert not found.at_the_end


@pytest.mark.parametrize("seeds", of_size(12, 24))
def test_uncertainty_of_latency_is_its_scatter(seeds: int):
    """Errors that vary slowly, as an arm's do: independent rows would promise far too much."""
    recorded, reference = motions(play=0 * PLAY)
    rng, time = np.random.default_rng(3), recorded.time
    deviations, promised = [], []
    for _ in range(seeds):
        waves = rng.standard_normal((3, 6))
        phase = rng.uniform(0, 2 * math.pi, 6)
        frequency = rng.uniform(0.5, 2.0, 6)
        error = 2e-4 * np.sin(2 * math.pi * frequency * time[:, None] + phase) @ waves.T
        noisy = Trajectory(NOWHERE, time, recorded.position + error)
        found = align(noisy, reference)
        deviations.append(found.latency - LATENCY)
        promised.append(found.latency_std)
    scatter = np.sqrt(np.mean(np.square(deviations)))
    assert 0.6 < np.mean(promised) / scatter < 1.6


def test_the_frames_are_found_with_the_latency():
    recorded, reference = motions(play=0 * PLAY)
    found = align(recorded, moved(reference), registered=True)
    assert found.latency == pytest.approx(LATENCY, abs=2e-6)
    np.testing.assert_allclose(found.rotation, TURN, atol=1e-5)
    np.testing.assert_allclose(found.position, SHIFT, atol=1e-5)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_hysteresis_is_found_by_joint_and_not_taken_for_latency(elsewhere: bool):
    """Although the geometry of the arm is wrong by half a millimetre, too."""
    recorded, reference = motions(geometry={"joint_4.z": 0.5715, "joint_3.offset": 3e-4})
    frame = {"registered": elsewhere}
    target = moved(reference) if elsewhere else reference
    found = compare(recorded, target, arm_named("suta"), **frame)
    assert found.per == "joint"
    assert found.assessment.usable
    assert abs(found.alignment.latency - LATENCY) < 5 * found.alignment.latency_std < 2e-4
    sizes = np.array([found.hysteresis[name] for name in arm_named("suta").joints])
    np.testing.assert_allclose(sizes[:, 0], PLAY, atol=np.radians(0.004))
    counts = [len(each.reversals) for each in found.reversals]
    # Two reversals a period, but for the ends of the record.
    np.testing.assert_allclose(counts, 2 * FREQUENCY * 14.0, atol=1.6)


def test_play_seems_latency_where_joints_are_not_known():
    recorded, reference = motions()
    plain = compare(recorded, reference)
    assert plain.per == "axis"
    assert plain.hysteresis == {}
    assert plain.alignment.latency > LATENCY + 2e-4
    assert any("the latency includes it" in note for note in plain.assessment.notes)


def test_errors_before_and_after_a_reversal():
    """Play of one joint alone: the jump is its lever times the play."""
    play = np.radians([0, 0, 0, 0, 0, 0.3])
    recorded, reference = motions(0.0, play)
    found = compare(recorded, reference, arm_named("suta"))
    last = found.reversals[5]
    lever = np.mean([np.linalg.norm(last.channel.lever[r.stop]) for r in last.reversals])
    assert last.jump == pytest.approx(lever * play[5], rel=0.1)
    assert last.error_before == pytest.approx(last.jump / 2, rel=0.15)
    assert last.error_after == pytest.approx(last.jump / 2, rel=0.15)


def test_figures_of_errors():
    recorded, reference = motions(0.02, 0 * PLAY, noise=0.0)
    found = compare(recorded, reference)
    forward = arm_named("suta").forward
    late = forward(true_angles(found.time - 0.02))[1] - forward(true_angles(found.time))[1]
    np.testing.assert_allclose(found.error_same_time, late, atol=1e-6)
    assert np.linalg.norm(found.error, axis=1).max() < 1e-6
    assert found.path_error.max() < 1e-6
    assert found.angle_error is not None
    assert found.angle_error.max() < 1e-4


def test_path_error_is_what_is_across_the_motion():
    time = np.arange(0, 4, 1 / RATE)
    line = np.sin(time)[:, None] * [1.0, 0.0, 0.0]
    aside = Trajectory(NOWHERE, time, line + np.array([0.0, 3e-3, 4e-3]))
    found = compare(aside, Trajectory(NOWHERE, time, line))
    np.testing.assert_allclose(found.path_error, 5e-3, rtol=1e-6)


def test_errors_that_grow_with_speed_are_told_by_speed():
    # Along a circle that is run through faster and faster, an error across it in proportion.
    time = np.arange(0, 6, 1 / RATE)
    angle = 0.2 * time**2
    circle = 0.1 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    speed = 0.1 * 0.4 * time
    aside = circle + speed[:, None] * np.array([0.0, 0.0, 0.01])
    found = compare(Trajectory(NOWHERE, time, aside), Trajectory(NOWHERE, time, circle))
    for quarter in found.by_speed:
        middle = np.linspace(quarter.low, quarter.high, 101)
        assert quarter.rms == pytest.approx(0.01 * np.sqrt(np.mean(middle**2)), rel=0.02)
    assert [q.low < q.high for q in found.by_acceleration] == [True] * 4
    # Towards the middle of the circle, and along it.
    fastest = math.hypot((0.04 * found.time[-1]) ** 2 / 0.1, 0.1 * 0.4)
    assert found.by_acceleration[-1].high == pytest.approx(fastest, rel=0.05)


def test_the_jackknife_tells_how_an_error_scatters():
    time = np.arange(0, 8, 1 / RATE)
    path = 0.1 * np.stack([np.sin(time), np.sin(1.7 * time), np.cos(0.6 * time)], axis=1)
    told, seen = [], []
    for seed in range(8):
        found = compare(noisy(time, path, seed, 1e-3), Trajectory(NOWHERE, time, path))
        told += [quarter.std for quarter in found.by_speed]
        seen += [quarter.rms for quarter in found.by_speed]
    assert 0.6 < np.std(seen) / np.sqrt(np.mean(np.square(told))) < 1.6


@pytest.mark.parametrize("rate", [60.0, 120.0, 768.0])
def test_a_pose_ages_until_the_next_one_comes(rate: float):
    time = np.arange(0, 4, 1 / RATE)
    line = Trajectory(NOWHERE, time, 0.5 * time[:, None] * [1.0, 0.0, 0.0])
    found = compare(line, line)
    assert found.staleness(rate) == pytest.approx(0.5 / rate / math.sqrt(3), rel=0.01)


def test_a_latency_beyond_the_search_is_not_usable():
    found = compare(*motions(0.3, 0 * PLAY), largest_latency=0.1)
    assert not found.assessment.usable
    assert "raise --max-latency" in found.assessment.notes[0]


def noisy(time: FloatArray, position: FloatArray, seed: int, std: float = 2e-5) -> Trajectory:
    noise = std * np.random.default_rng(seed).standard_normal(position.shape)
    return Trajectory(NOWHERE, time, position + noise)


@pytest.mark.parametrize("which", ["reference", "recording"])
def test_a_motion_in_another_unit_is_told_so(which: str):
    recorded, reference = motions(0.01, 0 * PLAY)
    small = recorded if which == "reference" else reference
    small.position[:] *= 1e-3
    found = compare(recorded, reference)
    assert not found.assessment.usable
    assert found.assessment.notes[0].startswith(f"The motion of the {which} is ")
    assert "one of them is in mm" in found.assessment.notes[0]


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_an_arm_at_rest_tells_no_latency(seed: int):
    time = np.arange(0, 12, 1 / RATE)
    still = np.tile([0.4, 0.1, 0.2], (len(time), 1))
    found = compare(noisy(time, still, seed, 1e-5), noisy(time, still, 99 + seed, 5e-5))
    assert not found.assessment.usable
    assert "contains only noise" in found.assessment.notes[0]


@pytest.mark.parametrize("std", [0.0, 2e-5])
@pytest.mark.parametrize("latency", [0.012, 0.2])
def test_a_motion_that_repeats_itself_tells_the_latency_but_for_periods(latency: float, std: float):
    time = np.arange(0, 12, 1 / RATE)

    def place(time: FloatArray) -> FloatArray:
        phase = 2 * math.pi * 4.0 * time[:, None] + [0.0, 1.5, 1.0]
        return 0.02 * np.sin(phase) * [1, 1, 0.3]

    recorded = noisy(time, place(time - latency), 1, std)
    reference = noisy(time, place(time), 2, std)
    found = compare(recorded, reference)
    alignment = found.alignment
    told = [alignment.latency, *alignment.as_good]
    assert abs(alignment.latency) == min(map(abs, told))
    np.testing.assert_allclose(
        np.sort(told), latency + 0.25 * np.round((np.sort(told) - latency) / 0.25), atol=2e-5
    )
    assert len(told) == 4
    assert min(abs(each - latency) for each in told) < 2e-5
    assert not found.assessment.usable
    assert "The motion repeats itself" in found.assessment.notes[0]
    # Who knows that it is less than half a period says so, and is believed.
    sure = compare(recorded, reference, largest_latency=0.12)
    assert sure.alignment.as_good == ()
    assert sure.assessment.usable


def test_one_move_or_cycles_longer_than_the_search_are_no_repetition():
    time = np.arange(0, 12, 1 / RATE)

    def once(time: FloatArray) -> FloatArray:
        s = np.clip((time - 7) / 0.5, 0, 1)
        return (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * [0.2, 0.1, -0.05]

    def cycles(time: FloatArray) -> FloatArray:
        return 0.1 * np.abs(2 * ((time / 0.9) % 1) - 1)[:, None] * [1, 0.2, 0]

    for place in (once, cycles):
        found = compare(noisy(time, place(time - 0.03), 1), noisy(time, place(time), 2))
        assert found.alignment.latency == pytest.approx(0.03, abs=1e-4)
        assert found.assessment.usable


@pytest.mark.parametrize(
    ("order", "signs", "said"),
    [
        ([1, 0, 2], [1, 1, 1], "y, x, z"),
        ([0, 1, 2], [1, -1, 1], "x, -y, z"),
        ([2, 0, 1], [1, 1, -1], "y, -z, x"),
    ],
)
def test_swapped_axes_are_named(order: list[int], signs: list[int], said: str):
    recorded, reference = motions(play=0 * PLAY)
    swapped = Trajectory(NOWHERE, recorded.time, recorded.position[:, order] * signs)
    found = compare(swapped, reference)
    assert not found.assessment.usable
    assert f"axes are taken as {said}, the recording follows" in found.assessment.notes[0]


def test_turning_points_are_counted_once_although_the_signal_trembles():
    time = np.linspace(0, 10, 5001)
    x = np.sin(2 * math.pi * time) + 0.01 * np.random.default_rng(0).standard_normal(5001)
    found = turning_points(x, 0.1)
    assert [sense for _, sense in found] == [-1, 1] * 10
    np.testing.assert_allclose(
        time[[row for row, _ in found]], 0.25 + 0.5 * np.arange(20), atol=0.06
    )


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_a_joint_that_never_turns_back_has_no_reversals(end: float):
    assert turning_points(np.linspace(0, end, 100), 0.01) == []


def write(path: Path, trajectory: Trajectory, *, joints: bool = False, mm: bool = False) -> Path:
    unit, scale = ("_mm", 1e3) if mm else ("", 1.0)
    names = ["time", *(f"{axis}{unit}" for axis in "xyz")]
    columns = [trajectory.time[:, None], scale * trajectory.position]
    if trajectory.rotation is not None:
        names += ["qx", "qy", "qz", "qw"]
        columns.append(Rotation.from_matrix(trajectory.rotation).as_quat())
    if joints:
        names += [f"joint_{k}" for k in range(1, 7)]
        columns.append(trajectory.angles)
    table = np.hstack(columns)
    np.savetxt(path, table, "%.9f", ",", header=",".join(names), comments="")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("motions")
    recorded, reference = motions(seconds=12.0)
    return (
        write(folder / "recorded.csv", recorded, joints=True),
        write(folder / "reference.csv", moved(reference), mm=True),
    )


@pytest.mark.usefixtures("drawn")
def test_command_prints_json_and_writes_a_picture(files, tmp_path: Path, capsys):
    out = tmp_path / "out"
    options = ("--urdf", SUTA_URDF, "--tip", "tip", "--register", "--json", "--out", out)
    assert cli("dynamics", *files, *options) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["latency"]["value_ms"] == pytest.approx(1e3 * LATENCY, abs=0.1)
    channels = {each["name"]: each for each in answer["reversals"]["channels"]}
    assert channels["joint_6"]["hysteresis_deg"] == pytest.approx(0.2, abs=0.01)
    assert answer["errors"]["latency_removed"]["rms_mm"] < answer["errors"]["same_time"]["rms_mm"]
    transform = np.array(answer["registration"]["T_reference_recorded"])
    np.testing.assert_allclose(transform[:3, 3], SHIFT, atol=2e-3)
    assert answer["verdict"]["usable"]
    assert json.loads((out / "result.json").read_text())["latency"] == answer["latency"]
    picture = (out / "dynamics.svg").read_text()
    assert picture.startswith("<svg")
    assert "Hysteresis" in picture


def test_command_prints_a_table(files, capsys):
    assert cli("dynamics", *files, "--register") == 0
    text = capsys.readouterr().out
    assert "Latency 12." in text
    assert "Take care" in text
    assert max(map(len, text.splitlines())) <= 80


def test_frames_that_differ_are_not_taken_for_latency(files, capsys):
    assert cli("dynamics", *files) == 1
    assert "different frames (--register)" in " ".join(capsys.readouterr().out.split())


def test_positions_come_from_the_arm_where_the_file_has_none(files, tmp_path: Path):
    recorded = read_trajectory(files[0], arm_named("suta"))
    only_joints = tmp_path / "joints.csv"
    header = ",".join(["time", *(f"joint_{k}" for k in range(1, 7))])
    table = np.column_stack([recorded.time, recorded.angles])
    np.savetxt(only_joints, table, "%.9f", ",", header=header, comments="")
    found = read_trajectory(only_joints, arm_named("suta"))
    np.testing.assert_allclose(found.position, recorded.position, atol=1e-8)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["0,0,0,0"] * 30, "line 3|:3: column 'time': found 0 after 0"),
        ([f"{k},0,0,0" for k in range(5)], "found 5 valid rows; expected at least 20"),
        ([f"{k},0,x,0" for k in range(30)], "column 'y': found 'x'"),
    ],
)
def test_bad_motions_are_one_clear_line(tmp_path: Path, files, capsys, rows: list[str], said: str):
    bad = tmp_path / "bad.csv"
    bad.write_text("\n".join(["time,x,y,z", *rows]))
    assert cli("dynamics", bad, files[1]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert any(part in error for part in said.split("|"))


def test_motions_of_different_times_are_refused():
    recorded, reference = motions(play=0 * PLAY, seconds=5.0)
    later = Trajectory(NOWHERE, recorded.time + 100, recorded.position)
    with pytest.raises(SamplesError, match="both files must use the same clock"):
        align(later, reference)


def test_a_reference_that_stands_still_tells_no_time():
    recorded, reference = motions(play=0 * PLAY, seconds=5.0)
    still = Trajectory(NOWHERE, reference.time, 0 * reference.position)
    with pytest.raises(SamplesError, match="does not move"):
        align(recorded, still)


def test_urdf_and_tip_go_together(files, capsys):
    assert cli("dynamics", *files, "--urdf", SUTA_URDF) == 2
    assert "--urdf needs --tip" in capsys.readouterr().err
    assert cli("dynamics", *files, "--tip", "tip") == 2
    assert "give the arm with --urdf" in capsys.readouterr().err
