"""``suta-calib measure`` on an arm that sends what an accelerometer feels beside its joints."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, refused
from emulated import decoded
from five_joints import AXES, urdf

from suta_calib.arrays import FloatArray
from suta_calib.emulation import EmulatedArm, Emulation, EmulationOptions, Faults, Timing
from suta_calib.emulation.emulated import emulated_device
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import read_csv_table

OFFSETS = {"j2.offset": 2.0, "j3.offset": -1.5, "j4.offset": 1.8, "j5.offset": -2.2}
JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters: [{select: ['*.offset'], bound_deg: 15}]
observations:
  - {kind: gravity, samples: 'calibration/*.csv', sensor: {rotation_rpy_deg: [0, 0, 90]}}
solver: {starts: 1}
"""
ACCELERATIONS = ["ax", "ay", "az"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A job without samples, and the truth."""
    (tmp_path / "arm.urdf").write_text(urdf(AXES["crossed"]))
    (tmp_path / "calibration.yaml").write_text(JOB)
    rows = "".join(f"  {name}: {{value_deg: {value}}}\n" for name, value in OFFSETS.items())
    (tmp_path / "truth.yaml").write_text(f"parameters:\n{rows}")
    return tmp_path


def emulation(folder: Path, rests: int, timing: Timing, faults: str = "") -> Emulation:
    options = EmulationOptions(
        folder / "arm.urdf",
        tip="tip",
        rate=200.0,
        motion="postures",
        directions=rests,
        timing=timing,
        truth=folder / "truth.yaml",
        accelerometer=rotation_from_rpy(np.radians([0.0, 0.0, 90.0])),
        form="lines",
        unit="rad",
        faults=Faults.parse(faults),
    )
    return emulated_device(options).emulation


def spoilt(
    given: Emulation, timing: Timing, change: Callable[[int, FloatArray], object]
) -> Emulation:
    """Its accelerometer's values changed at rests by their number."""
    assert given.extra is not None
    values = given.extra.values.copy()
    rest = np.floor((given.extra.time + timing.move / 2) / (timing.rest + timing.move)).astype(int)
    for k in range(rest.max() + 1):
        values[rest == k] = change(k, values[rest == k])
    return replace(given, extra=replace(given.extra, values=values))


def measured(folder: Path, rests: int, *more: object) -> list[str]:
    device = ["--device", folder / "device.yaml"]
    command = ["measure", folder / "calibration.yaml", *device, "--free", "--yes"]
    return [str(word) for word in (*command, "--rests", rests, "--seconds", 0.4, *more)]


def recorded(folder: Path, given: Emulation, seconds: float, rests: int) -> list[str]:
    """The command over a recording of what an arm sends."""
    readings, _ = decoded(given, seconds)
    rows = [[r.time, *r.angles, *r.extra] for r in readings]
    header = ",".join(["time", *given.device.names, *ACCELERATIONS])
    recording = folder / "recording.csv"
    np.savetxt(recording, rows, "%.9g", ",", header=header, comments="")
    command = ["measure", folder / "calibration.yaml", "--recording", recording, "--free"]
    return [str(word) for word in (*command, "--rests", rests, "--seconds", 0.4)]


def off(folder: Path) -> dict[str, float]:
    """How far each offset of the calibrated arm is from the truth, deg."""
    found = answer("calibrate", folder / "calibration.yaml", "--out", folder / "results")
    assert found["parameters"]["j1.offset"]["state"] == "unidentified"
    estimates = {name: found["parameters"][name]["value"] for name in OFFSETS}
    return {name: math.degrees(value) - OFFSETS[name] for name, value in estimates.items()}


def test_what_was_recorded_becomes_samples_that_show_the_zeros_of_the_joints(folder: Path) -> None:
    """Twenty-five postures, 2° of offsets, 0.2° of noise: joints 2 to 5 within 0.15°."""
    given = emulation(folder, 25, Timing(0.9, 0.3))
    command = recorded(folder, given, 25 * 1.2, 25)
    assert cli(*command) == 0
    table = read_csv_table(folder / "calibration" / "free_1.csv")
    assert list(table.columns) == [*given.device.names, "repeat", *ACCELERATIONS]
    assert len(table) == 25
    assert max(map(abs, off(folder).values())) < 0.15
    # In motion an accelerometer shows more than gravity: no samples of it.
    assert cli(*command[:4], "--free", "--continuous", 2) == 0
    swept = read_csv_table(folder / "free_1.csv")
    assert not {*ACCELERATIONS} & {*swept.columns}


@pytest.mark.slow
def test_the_same_from_a_port(folder: Path) -> None:
    # A busy computer may miss some rests: there are more of them.
    with EmulatedArm(emulation(folder, 32, Timing(1.2, 0.4)), patient=True) as emulator:
        emulator.write_device(folder / "device.yaml")
        assert cli(*measured(folder, 25)) == 0
    assert max(map(abs, off(folder).values())) < 0.15


def test_a_bad_cable_costs_no_rest(folder: Path, capsys: Capture) -> None:
    # The cable is pulled out at the second rest. A busy computer may miss others: there are more.
    timing, rests = Timing(1.0, 0.3), 14
    given = emulation(folder, rests, timing, "corrupt=0.01,burst=0.1@0.7,disconnect=0.4@1.6")
    with EmulatedArm(given, patient=True) as emulator:
        emulator.write_device(folder / "device.yaml")
        raw = folder / "raw.parquet"
        assert cli(*measured(folder, 4, "--patience", 20, "--raw", raw)) == 0
    out = capsys.readouterr().out
    assert "connected again" in out
    assert "lines that cannot be read" in out
    table = read_csv_table(folder / "calibration" / "free_1.csv")
    found = np.column_stack([table.numbers(name, "numbers") for name in ACCELERATIONS])
    q = np.column_stack([table.numbers(name, "numbers") for name in given.device.names])
    middles = np.arange(rests) * (timing.rest + timing.move) + timing.rest / 2
    away = np.abs(given.motion.readings(middles) - q[:, None]).max(axis=2)
    assert away.min(axis=1).max() < 1e-5
    at = away.argmin(axis=1)
    assert at[0] == 0
    assert len({*at.tolist()}) == 4
    assert given.extra is not None
    assert np.abs(found - given.extra.readings(middles[at])).max() < 0.02


def test_rests_whose_sensor_did_not_rest_are_left_out_and_named(
    folder: Path, capsys: Capture
) -> None:
    timing, rests = Timing(1.0, 0.3), 6

    def change(rest: int, values: FloatArray) -> object:
        alternating = (-1.0) ** np.arange(len(values))[:, None]
        shaken, empty = values + 2.0 * alternating, np.where(np.arange(3) == 1, np.nan, values)
        return (values, shaken, shaken, empty, empty, values / 9.81)[rest]

    given = spoilt(emulation(folder, rests, timing), timing, change)
    assert cli(*recorded(folder, given, rests * (timing.rest + timing.move), rests)) == 1
    out = capsys.readouterr().out
    assert "the readings of the accelerometer scattered by" in out
    assert "of the readings of ay are no numbers" in out
    assert "Are g and m/s² mixed?" in out
    table = read_csv_table(folder / "calibration" / "free_1.csv")
    assert len(table) == 1
    lengths = np.linalg.norm([table.numbers(name, "") for name in ACCELERATIONS], axis=0)
    np.testing.assert_allclose(lengths, 9.81, rtol=0.01)
    assert "run the same command with --resume" in out


def test_columns_that_do_not_come_are_named(folder: Path) -> None:
    given = emulation(folder, 2, Timing())
    silent = replace(given, extra=None, device=replace(given.device, extra_columns=()))
    with EmulatedArm(silent) as emulator:
        device = emulator.write_device(folder / "device.yaml")
        device.write_text(device.read_text() + "extra_columns: [ax, ay, az]\n")
        said = refused(*measured(folder, 2))
    assert "of 5 values; expected 8" in said
    assert "'joints' and 'extra_columns'" in said
    assert not (folder / "calibration").exists()


def test_a_column_that_is_a_label_is_refused(folder: Path) -> None:
    text = "port: x\nformat: lines\nunit: rad\njoints: [{name: j1}, {name: j2}, {name: j3}, "
    text += "{name: j4}, {name: j5}]\nextra_columns: [point]\n"
    (folder / "device.yaml").write_text(text)
    job = folder / "calibration.yaml"
    job.write_text(JOB.replace("solver:", "  - {kind: fixed_point, samples: p/*.csv}\nsolver:"))
    said = refused("measure", job, "--device", folder / "device.yaml", "--point", "F1")
    assert "extra_columns: found 'point', which is a label of these samples" in said


def test_only_lines_are_emulated_with_an_accelerometer(folder: Path) -> None:
    more = ("--tip", "tip", "--motion", "postures", "--accelerometer", 0, 0, 90, "--seconds", 0.01)
    assert "format: found frames with ax, ay, az; expected lines" in refused(
        "emulate", folder / "arm.urdf", *more
    )
