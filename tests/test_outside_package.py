"""A package outside `suta_calib` adds a kind, a reader, a writer, a format and a hypothesis.

`tests/support/outside_package` is installed in the test environment. Nothing of `suta_calib` names
it; `tests/cli/test_every_kind.py` runs every command over its kind.
"""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli_job import cli
from device_streams import device
from simulated import arm_named
from suta_calib_tilt.inclinometer import Inclinometer, _across

from suta_calib import KINDS, Noise, ParameterSet, Problem, Samples, Selection, assess, solve
from suta_calib.check import Checker
from suta_calib.device import FORMATS, decoder_for
from suta_calib.device.formats import Sample
from suta_calib.errors import SamplesError
from suta_calib.exchange import export_formats, import_formats, read_foreign
from suta_calib.registry import shipped
from suta_calib.terms import ArmPoses, Block, Setup
from suta_calib.trust import CalibrationExamination, examine, known_hypotheses

ARM = arm_named("suta")
UNKNOWN: ParameterSet = ARM.select(Selection("joint_*.offset", bound_rad=0.1))
TRUTH = {"joint_3.offset": 0.01, "joint_5.offset": -0.02}
OWN = {"sensor.rx": 0.3, "sensor.ry": -0.2, "sensor.rz": 2.0, "up.rx": 0.05, "up.ry": -0.1}
NOISE = np.radians(0.01)


def tilts(count: int = 40, seed: int = 0, noise: float = NOISE) -> Inclinometer:
    """What a sensor on the SUTA reads, with known truth."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.5, 1.5, (count, len(ARM.joints)))
    nothing = {"roll": np.zeros(count), "pitch": np.zeros(count)}
    poses = ArmPoses(ARM, Samples.from_arrays(ARM.joints, q, numbers=nothing))
    ideal = Inclinometer(poses).observed(TRUTH | OWN, poses).numbers
    numbers = {n: v + noise * random.standard_normal(count) for n, v in ideal.items()}
    return Inclinometer(ArmPoses(ARM, Samples.from_arrays(ARM.joints, q, numbers=numbers)))


def test_all_of_it_is_found() -> None:
    for known, name in (
        (KINDS, "inclinometer"),
        (import_formats(), "tilt-log"),
        (export_formats(), "offsets-csv"),
        (FORMATS, "semicolon-lines"),
        (known_hypotheses(), "inclinometer gain"),
    ):
        assert name in known
        assert name not in shipped(known)


def test_its_kind_is_zero_at_the_truth_and_starts_there() -> None:
    term = tilts(noise=0.0)
    problem = Problem([term], UNKNOWN)
    x = np.array([{**TRUTH, **OWN}.get(name, 0.0) for name in problem.names])
    (line,) = problem.linearise(x, [1.0])
    np.testing.assert_allclose(line.residual, 0.0, atol=1e-12)
    start = term.start(*term.poses.at(TRUTH))
    np.testing.assert_allclose(start, [OWN[p.name] for p in term.own_parameters], atol=1e-9)


def test_its_kind_calibrates_from_python() -> None:
    solution = solve(Problem([tilts()], UNKNOWN))
    assert solution.converged
    for name in ("joint_2.offset", "joint_3.offset", "joint_4.offset", "joint_5.offset"):
        estimate = solution.estimates[name]
        assert abs(estimate.value - TRUTH.get(name, 0.0)) < 4 * estimate.std < np.radians(0.1)
    # The first joint is vertical, and the last carries the sensor.
    assert solution.estimates["joint_1.offset"].std is None
    assert solution.estimates["joint_6.offset"].std is None
    gain = assess(solution, [tilts(15, seed=1)]).gain
    assert gain is not None
    assert gain.unit == "rad"
    assert gain.after < 2 * NOISE < gain.before


def test_its_hypothesis_is_checked_in_new_rows() -> None:
    """By `checked_as`: a gain that came after the calibration is told from all else."""
    checker = Checker(solve(Problem([tilts()], UNKNOWN)))
    hypothesis, random = known_hypotheses()["inclinometer gain"], np.random.default_rng(0)
    assert checker.check(tilts(12, seed=3)).unchanged
    spoilt = hypothesis.spoil(tilts(12, seed=3), TRUTH | OWN, random)
    (change, *_) = checker.check(spoilt.data).changed
    gain, std = change.amounts["1"]
    assert change.what == "inclinometer gain"
    assert gain == pytest.approx(0.01, abs=4 * std)
    assert std < 0.002


def test_its_hypothesis_names_its_fault_and_is_silent_on_sound_data() -> None:
    hypothesis = known_hypotheses()["inclinometer gain"]
    sound = tilts(seed=2, noise=5 * NOISE)
    spoilt = hypothesis.spoil(sound, TRUTH | OWN, np.random.default_rng(0))
    first, *_ = examine(CalibrationExamination.of(solve(Problem([spoilt.data], UNKNOWN))))
    assert first.hypothesis is hypothesis
    assert abs(first.evidence.size[0] - spoilt.size[0]) < 3 * first.evidence.std[0]
    assert "too little" in first.sentence
    assert not examine(CalibrationExamination.of(solve(Problem([sound], UNKNOWN))))


def test_its_reader_makes_samples_of_its_kind(tmp_path: Path) -> None:
    samples = tilts(30).poses.samples
    lines = ["TILTLOG 1"]
    for q, roll, pitch in zip(samples.q, *samples.numbers.values(), strict=True):
        cells = zip((*ARM.joints, "roll", "pitch"), np.degrees([*q, roll, pitch]), strict=True)
        lines.append(" ".join(f"{name}={value!r}" for name, value in cells))
    log = tmp_path / "run.tilt"
    log.write_text("\n".join(lines).replace("np.float64(", "").replace(")", ""))
    assert cli("import", log, "--out", tmp_path / "samples.csv") == 0
    imported = read_foreign(log)
    np.testing.assert_allclose(imported.columns["roll"], samples.numbers["roll"], atol=1e-12)
    log.write_text("TILTLOG 1\njoint_1=x\n")
    assert cli("import", log, "--out", tmp_path / "other.csv") == 2


def test_its_device_format_is_read_as_it_is_written() -> None:
    form = FORMATS["semicolon-lines"]
    spec = device(4, format=form.name)
    encoder, quiet = form.encoder(spec), np.zeros(4, dtype=bool)
    values = encoder.values(np.array([[0.0, 1.0, -2.0, 3.0]]))[0]
    packet = encoder.packet(Sample(0, 0, values, quiet, quiet))
    assert packet.count(b";") == 3
    reading = decoder_for(spec).feed(2 * packet, 0.0)[-1]
    np.testing.assert_allclose(reading.angles, [0.0, 1.0, -2.0, 3.0], atol=1e-5)


# ── residuals that are no function of a module ───────────────────────────────────────────────
@dataclass(frozen=True, eq=False, repr=False)
class Other(Inclinometer):
    """The same with another residual."""

    residual: Any = None

    @property
    def blocks(self) -> tuple[Block, ...]:
        (block,) = Inclinometer.blocks.func(self)  # type: ignore[attr-defined]
        return (replace(block, residual=self.residual or (lambda *of: _across(*of))),)


def test_a_lambda_as_residual_works_and_is_sent_to_other_processes() -> None:
    term = Other(tilts().poses)
    solution = solve(Problem([term], UNKNOWN))
    assert solution.converged
    assert solution.x == pytest.approx(solve(Problem([tilts()], UNKNOWN)).x, abs=1e-10)
    assert len(pickle.loads(pickle.dumps(term)).blocks[0]) == len(term.poses)


@pytest.mark.parametrize(
    ("residual", "says"),
    [
        (lambda _poses, own, _data: ca.vertcat(own[0], own[1], own[2]), r"of shape \(3, 1\); exp"),
        (lambda _poses, own, _: own[0] if own[0] > 0 else own[1], "cannot be evaluated on CasADi"),
        (lambda _poses, own, _data: np.arctan2(own[0], 1.0) * {}, "cannot be evaluated on CasADi"),
        (lambda _poses, own: own, "cannot be evaluated on CasADi symbols"),
        (lambda *_: None, "cannot be evaluated on CasADi symbols"),
        (lambda *_: ca.SX.sym("drift", 2), "unknown symbols: drift_0, drift_1; expected only"),
    ],
    ids=["size", "if", "type", "arguments", "nothing", "symbols"],
)
def test_a_residual_that_is_none_is_refused_in_words(residual: Any, says: str) -> None:
    term = Other(tilts().poses, residual=residual)
    with pytest.raises(SamplesError, match=says):
        solve(Problem([term], UNKNOWN))


def test_a_residual_may_be_a_list_of_components() -> None:
    def listed(*of: Any) -> list[Any]:
        value = _across(*of)
        return [value[0], value[1]]

    assert solve(Problem([Other(tilts().poses, residual=listed)], UNKNOWN)).converged


# ── columns of numbers ───────────────────────────────────────────────────────────────────────
def job_of(folder: Path, header: str, cells: str) -> int:
    term = tilts(20)
    (folder / "arm.urdf").write_bytes(ARM.chain.path.read_bytes())
    rows = [",".join([*map(repr, q.tolist()), cells]) for q in term.poses.samples.q]
    (folder / "s.csv").write_text("\n".join([f"{','.join(ARM.joints)},{header}", *rows]))
    (folder / "job.yaml").write_text(
        "arm: {urdf: arm.urdf, tip: tip}\nparameters: [{select: '*.offset', bound_deg: 5}]\n"
        "observations: [{kind: inclinometer, samples: s.csv}]\n"
    )
    return cli("observe", folder / "job.yaml")


@pytest.mark.parametrize(
    ("header", "cells", "says"),
    [
        ("roll,pitch", "0.1,x", "column 'pitch': found 'x'"),
        ("roll", "0.1", "column pitch in rad, or pitch_deg"),
        ("roll,roll_deg,pitch", "0.1,5,0.1", "found columns roll and roll_deg; expected either"),
    ],
)
def test_a_column_of_numbers_is_checked(
    header: str, cells: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert job_of(tmp_path, header, cells) == 2
    assert says in capsys.readouterr().err


def test_angles_are_read_in_degrees_too(tmp_path: Path) -> None:
    assert job_of(tmp_path, "roll_deg,pitch_deg", "10,-5") == 0


def test_what_it_measures_beside_lengths_has_no_scale(tmp_path: Path) -> None:
    term = KINDS["inclinometer"].over(tilts().poses, Setup(angular_noise=Noise(NOISE)))
    assert not term.measures_lengths()
    assert term.error_unit == "rad"
    assert json.dumps(term.places[0]) == "[]"
