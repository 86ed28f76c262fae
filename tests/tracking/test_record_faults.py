"""What a record got wrong is named, and honest records are not suspected (simulated)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from scipy.signal import lfilter
from simulated import arm_named
from studies import first_of
from tracking_scene import with_play

from suta_calib.arrays import FloatArray
from suta_calib.tracking.path_accuracy import PathAccuracy, compare
from suta_calib.tracking.record_faults import RecordFault
from suta_calib.tracking.trajectory import Trajectory, read_trajectory

NOWHERE = Path("motion.csv")
LATENCY = 0.02
TURN = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])
Motion = Callable[[FloatArray], FloatArray]


def waves(rng: np.random.Generator, slow: float = 1.0, size: float = 0.15) -> Motion:
    frequency, phase = slow * rng.uniform(0.1, 0.6, (3, 2)), rng.uniform(0, 2 * math.pi, (3, 2))
    amplitude = size * rng.uniform(0.3, 1.0, (3, 2))
    return lambda t: np.sum(
        amplitude * np.sin(2 * math.pi * frequency * t[:, None, None] + phase), axis=2
    )


def slow(rng: np.random.Generator) -> Motion:
    return waves(rng, 0.3, 0.1)


def fast(rng: np.random.Generator) -> Motion:
    return waves(rng, 3.0, 0.05)


def stops(rng: np.random.Generator) -> Motion:
    """Moves of half a second, and standing still between them."""
    places = rng.uniform(-0.2, 0.2, (80, 3))

    def place(t: FloatArray) -> FloatArray:
        k = np.floor((t + 2.0) / 1.1).astype(int)
        s = np.clip((t + 2.0 - 1.1 * k - 0.6) / 0.5, 0, 1)
        return places[k] + (places[k + 1] - places[k]) * _smooth(s)

    return place


def areas(rng: np.random.Generator) -> Motion:
    """In one place, and then in another, where other errors are."""
    around, here, there = waves(rng, 1.5, 0.05), *rng.uniform(-0.3, 0.3, (2, 3))
    return lambda t: around(t) + here + (there - here) * _smooth(np.clip((t - 5.0) / 0.6, 0, 1))


def once(rng: np.random.Generator) -> Motion:
    way, seconds = rng.uniform(-0.2, 0.2, 3), rng.uniform(0.5, 3.0)
    return lambda t: way * _smooth(np.clip((t - 5.0) / seconds, 0, 1))


def _smooth(s: FloatArray) -> FloatArray:
    return (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]


def correlated(
    rng: np.random.Generator, rows: int, rate: float, seconds: float, std: float
) -> FloatArray:
    """AR(1) noise with a time constant."""
    phi = math.exp(-1.0 / (rate * seconds))
    drive = std * math.sqrt(1 - phi**2) * rng.standard_normal((rows + 1000, 3))
    return np.asarray(lfilter([1.0], [1.0, -phi], drive, axis=0)[1000:])


def field(rng: np.random.Generator, size: float) -> Motion:
    """Errors that depend on the place, as those of an arm or an optical tracker do."""
    linear, ripple = size * rng.standard_normal((3, 3)), 0.4 * size * rng.standard_normal((3, 3))
    wave, phase = rng.uniform(3, 12, (3, 3)), rng.uniform(0, 2 * math.pi, 3)
    return lambda p: p @ linear + np.sin(p @ wave + phase) @ ripple


def record(
    seed: int, motion: Callable[[np.random.Generator], Motion] = waves, *, red: bool = False
) -> tuple[Trajectory, Trajectory]:
    """One of which only the noise, 0.2 mm, is to blame."""
    rng, rate = np.random.default_rng(seed), 100.0
    place, time = motion(rng), np.arange(0, 10, 1 / rate)
    noise = 2e-4 * rng.standard_normal((len(time), 3))
    if red:
        noise = correlated(rng, len(time), rate, 0.15, 2e-4)
    around = np.arange(-1, 11, 1 / rate)
    recorded = Trajectory(NOWHERE, time, place(time - LATENCY) + noise)
    return recorded, Trajectory(NOWHERE, around, place(around))


def honest(seed: int) -> PathAccuracy:
    """Of any kind of motion, rate, noise and honest error."""
    rng = np.random.default_rng(seed)
    place = (waves, slow, fast, stops, areas, once)[seed % 6](rng)
    rate, seconds = rng.choice([60.0, 120.0, 333.0, 768.0]), rng.choice([9.0, 15.0, 25.0])
    time = np.arange(-1, seconds, 1 / rate)
    around = np.arange(-2, seconds + 1, 1 / rng.choice([100.0, 250.0]))
    truth = place(around)
    there = place(time - rng.uniform(-0.05, 0.05))
    position = there
    if rng.random() < 0.4:
        position = with_play(position, rng.uniform(0, 1e-3, 3))
    if rng.random() < 0.5:
        position = position + field(rng, 10 ** rng.uniform(-3, -2))(there)
    std, rows = 10 ** rng.uniform(-5, -3), len(time)
    kind = rng.integers(3)
    if kind == 0:
        position = position + std * rng.standard_normal((rows, 3))
    elif kind == 1:
        position = position + correlated(rng, rows, rate, rng.uniform(0.05, 0.5), std)
    if rng.random() < 0.3:
        position = np.round(position / 1e-4) * 1e-4
    # One move is on a line, which nothing registers.
    if registered := rng.random() < 0.3 and seed % 6 != 5:
        truth = truth @ TURN.T + [1.0, 2.0, 3.0]
    recorded = Trajectory(NOWHERE, time[time >= 0], position[time >= 0])
    return compare(recorded, Trajectory(NOWHERE, around, truth), registered=registered)


def honest_arm(seed: int) -> PathAccuracy:
    """An arm with play, and with a geometry that is wrong by half a millimetre."""
    rng, arm = np.random.default_rng(seed), arm_named("suta")
    rate, wrong = rng.choice([60.0, 200.0]), 5e-4 * rng.standard_normal(2)
    middle, phase = np.array([0.2, 0.3, -0.4, 0.2, 0.5, 0.1]), rng.uniform(0, 2 * math.pi, 6)
    amplitude, frequency = rng.uniform(0.05, 0.5, 6), rng.uniform(0.1, 0.6, 6)
    time = np.arange(-2, 12, 1 / rate)

    def angles(t: FloatArray) -> FloatArray:
        turned = np.sin(2 * math.pi * frequency * t[:, None] + phase)
        return np.asarray(middle + amplitude * turned)

    read = with_play(angles(time - 0.012), np.radians(rng.uniform(0, 0.1, 6)))
    read += 10 ** rng.uniform(-6, -4.5) * rng.standard_normal(read.shape)
    geometry = {"joint_4.z": 0.571 + wrong[0], "joint_3.offset": wrong[1]}
    truth = arm.forward(angles(time), geometry)[1]
    truth = truth + 1e-4 * rng.standard_normal(truth.shape)
    if registered := rng.random() < 0.3:
        truth = truth @ TURN.T + [1.0, 2.0, 3.0]
    now = time >= 0
    recorded = Trajectory(NOWHERE, time[now], arm.forward(read[now])[1], None, read[now])
    known = arm if rng.random() < 0.6 else None
    return compare(recorded, Trajectory(NOWHERE, time, truth), known, registered=registered)


def spoilt(recorded: Trajectory, fault: str, row: int, rng: np.random.Generator) -> Trajectory:
    time, position = recorded.time.copy(), recorded.position.copy()
    aside = rng.standard_normal(3)
    aside /= np.linalg.norm(aside)
    match fault:
        case "clock 1 %":
            time *= 1.01
        case "clock 0.1 %":
            time *= 1.001
        case "gap of 50 ms":
            time[row:] += 0.05
        case "gap of 20 ms":
            time[row:] += 0.02
        case "stuck for 0.5 s":
            position[row : row + 50] = position[row]
        case "stuck for 0.1 s":
            position[row : row + 10] = position[row]
        case "5 mm from there on":
            position[row:] += 5e-3 * aside
        case "5 mm for 0.2 s":
            position[row : row + 20] += 5e-3 * aside
        case "50 mm in one row":
            position[row] += 50e-3 * aside
        case _:
            raise AssertionError(fault)
    return replace(recorded, time=time, position=position)


FAULTS = {
    "clock 1 %": ("rate", 0.01 / 1.01),
    "clock 0.1 %": ("rate", 0.001 / 1.001),
    "gap of 50 ms": ("step", 0.05),
    "gap of 20 ms": ("step", 0.02),
    "stuck for 0.5 s": ("stuck", None),
    "stuck for 0.1 s": ("stuck", None),
    "5 mm from there on": ("jump", 5e-3),
    "5 mm for 0.2 s": ("jump", 5e-3),
    "50 mm in one row": ("wild", 50e-3),
}


def fault_of(seed: int, fault: str, *, red: bool = False, elsewhere: bool = False) -> RecordFault:
    """The only one that is found."""
    rng = np.random.default_rng(100 + seed)
    recorded, reference = record(seed, red=red)
    if elsewhere:
        reference = replace(reference, position=reference.position @ TURN.T + [1.0, 2.0, 3.0])
    bad = spoilt(recorded, fault, 400 + seed, rng)
    found = compare(bad, reference, registered=elsewhere)
    (one,) = found.faults
    assert found.assessment.notes[0] == one.sentence
    return one


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(("red", "elsewhere"), [(False, False), (True, False), (False, True)])
def test_what_a_record_got_wrong_is_named(fault: str, red: bool, elsewhere: bool):
    kind, size = FAULTS[fault]
    found = fault_of(1, fault, red=red, elsewhere=elsewhere)
    assert found.kind == kind
    assert found.spoils
    if kind not in ("rate", "wild"):
        assert abs(found.since - (4.01 + (size if kind == "step" else 0.0))) < 0.025
    if size is not None:
        assert abs(found.size - size) < (5 * found.std if found.std > 0 else 1e-3)
        assert not found.std > 0.1 * size
    # Without it the answer is that of the record as it was.
    assert found.rms == pytest.approx(2e-4 * math.sqrt(3), rel=0.15)
    if kind not in ("rate", "step"):
        assert found.latency == pytest.approx(LATENCY, abs=3e-4)


def test_the_rate_of_a_clock_scatters_as_its_std_says():
    found = [fault_of(seed, "clock 0.1 %") for seed in range(8)]
    off = [(each.size - 0.001 / 1.001) / each.std for each in found]
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.8


def test_a_row_that_hardly_matters_is_told_with_care():
    recorded, reference = record(3)
    recorded.position[500] += [0.0, 5e-3, 0.0]
    found = compare(recorded, reference)
    assert [(each.kind, each.spoils) for each in found.faults] == [("wild", False)]
    assert found.assessment.level == "care"
    assert "1 row is away from the rows before and after by" in found.assessment.notes[0]
    assert "(row 500, at 5.000 s). Leave it out." in found.assessment.notes[0]


def test_several_of_a_kind_are_one_note():
    recorded, reference = record(4)
    for row, rows in ((250, 15), (600, 40)):
        recorded.position[row : row + rows] = recorded.position[row]
    recorded.position[[400, 480]] += [0.03, 0.0, 0.0]
    stuck, wild = compare(recorded, reference).faults
    assert "keeps the same value 2 times, longest from 6.000 s to 6.3" in stuck.sentence
    assert "2 rows are away from the rows before and after by up to 3" in wild.sentence


@pytest.mark.parametrize("motion", [waves, slow, fast, stops, areas, once])
def test_an_honest_record_is_not_suspected(motion: Callable[[np.random.Generator], Motion]):
    for red in (False, True):
        assert compare(*record(7, motion, red=red)).faults == ()


@pytest.mark.parametrize("seed", first_of(range(6)))
def test_honest_errors_of_many_kinds_are_not_suspected(seed: int):
    assert honest(seed).faults == ()
    if seed < 4:
        assert honest_arm(seed).faults == ()


def test_few_rows_are_not_judged():
    recorded, reference = record(5)
    few = Trajectory(NOWHERE, recorded.time[::25], recorded.position[::25])
    assert compare(few, reference).faults == ()


@pytest.mark.slow
def test_false_alarms_are_rare():
    """At most one in a hundred honest records, of motions that tell a latency at all."""
    found = [honest(seed) for seed in range(1300, 1600)]
    found += [honest_arm(seed) for seed in range(1000, 1100)]
    usable = [each for each in found if each.assessment.usable or each.faults]
    assert len(usable) > 350
    assert sum(bool(each.faults) for each in usable) <= len(usable) / 100


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_faults_clearly_above_the_noise_are_found(fault: str):
    for seed in range(12):
        for red, elsewhere in ((False, False), (True, False), (False, True)):
            found = fault_of(seed, fault, red=red, elsewhere=elsewhere)
            assert found.kind == FAULTS[fault][0]
            assert found.spoils


def test_the_command_names_file_and_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    recorded, reference = record(6)
    bad = spoilt(recorded, "stuck for 0.5 s", 400, np.random.default_rng(0))
    files = tmp_path / "recorded.csv", tmp_path / "reference.csv"
    for path, each in zip(files, (bad, reference), strict=True):
        table = np.column_stack([each.time, each.position])
        np.savetxt(path, table, "%.9f", ",", header="time,x,y,z", comments="")
    assert read_trajectory(files[0]).origin(400) == "recorded.csv:402"
    assert cli("path-accuracy", *files, "--json") == 1
    answer = json.loads(capsys.readouterr().out)
    (fault,) = answer["faults"]
    assert (fault["kind"], fault["spoils"]) == ("stuck", True)
    assert (fault["first"], fault["since_s"]) == ("recorded.csv:402", 4.0)
    assert abs(fault["until_s"] - 4.49) < 0.015
    assert fault["size_mm"] > 20
    assert fault["rms_mm"] < 0.5 < answer["errors"]["latency_removed"]["rms_mm"]
    assert "the same value from 4.000 s" in answer["verdict"]["notes"][0]
