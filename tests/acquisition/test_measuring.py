"""Measuring from Python, without the command line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from measuring_bench import Bench

from suta_calib.acquisition import MeasureOptions, measure
from suta_calib.atomic import only_writer
from suta_calib.emulation import EmulatedArm
from suta_calib.errors import InputError, OutputError


@pytest.fixture
def bench(tmp_path: Path, repository: Path) -> Bench:
    return Bench.made(tmp_path, repository)


def test_a_placement_is_measured_by_a_call(bench: Bench) -> None:
    said: list[str] = []
    shown: list[str] = []
    emulation = bench.emulation(bench.stops("O,M1", rest=0.6))
    with EmulatedArm(emulation, patient=True) as emulator:
        options = MeasureOptions(
            job=bench.job,
            device=emulator.write_device(bench.folder / "device.yaml"),
            labels={"placement": "P1"},
            sequence=("O", "M1"),
            seconds=0.2,
            unattended=True,
        )
        measured = measure(options, say=said.append, show=shown.append)
    assert (measured.status, measured.samples, measured.missing) == ("complete", 2, ())
    assert measured.file == bench.folder / "calibration" / "P1_1.csv"
    assert "no losses" in measured.happened[0]
    assert any(line.startswith("M1: recorded") for line in said)
    assert any(line.startswith("resting") for line in shown)
    bench.check(bench.samples())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "one of --placement"),
        ({"labels": {"point": "F1"}, "free": True}, "--point and --free"),
        ({"labels": {"placement": "P1"}, "continuous": 3.0}, "--continuous with --placement"),
    ],
)
def test_options_that_contradict_each_other_are_refused(
    given: dict[str, object], said: str
) -> None:
    options = MeasureOptions(Path("job.yaml"), Path("device.yaml"), **given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=said):
        measure(options)


def test_one_file_is_measured_by_one_at_a_time(bench: Bench) -> None:
    device = bench.folder / "device.yaml"
    joints = ", ".join(f"{{name: {joint}}}" for joint in bench.arm.joints)
    device.write_text(f"port: {bench.folder}/none\njoints: [{joints}]\n")
    options = MeasureOptions(bench.job, device, {"placement": "P1"}, unattended=True)
    with (
        only_writer(bench.folder / "calibration" / "P1_1.csv"),
        pytest.raises(OutputError, match=r"P1_1\.csv: found process"),
    ):
        measure(options)
    with pytest.raises(OutputError, match="an input of the same command"):
        measure(replace(options, out=bench.job))
