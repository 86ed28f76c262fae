"""What a calibration leaves: found where it is there, refused where it is noise."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import NOISE, TRUTH, answer, cli, refused, write_simulated_job
from scipy.spatial.transform import Rotation
from simulated import SUTA_URDF, arm_named, range_scene
from studies import first_of

from suta_calib import Calibration, Selection, SolverOptions, TrackedPoint, calibrate
from suta_calib.analysis.residual_map import LeftOut, ResidualMap, ResidualMapOptions, residual_map
from suta_calib.analysis.residual_map.export import correction_record, python_text, table_text
from suta_calib.analysis.residual_map.residuals import fitted_residuals, tip_residuals
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.errors import InputError, MissingExtraError, SamplesError, UnusableResultError
from suta_calib.measurements import Samples, write_samples

ARM = arm_named("suta")
SCATTER = 5e-5
RANGE = 1.2


def ripple(q: FloatArray) -> FloatArray:
    """Readings that joints 1 and 2 really have: no parameter of the arm is of this shape."""
    turned = q.copy()
    turned[:, 0] += 1.5e-3 * np.sin(7.0 * q[:, 0])
    turned[:, 1] += 1.0e-3 * np.sin(5.0 * q[:, 1] + 1.0)
    return turned


def bow(q: FloatArray) -> FloatArray:
    """(n, 3) displacement of the tip that hangs on several joints together, m."""
    along = [np.sin(2 * q[:, 1] + q[:, 2]), np.cos(2 * q[:, 1] - q[:, 2]), np.sin(2 * q[:, 2])]
    return 1.5e-3 * np.stack(along, axis=1)


def true_tip(what: str, q: FloatArray) -> FloatArray:
    """Where the tip really is, m."""
    if what == "ripple":
        return ARM.forward(ripple(q))[1]
    return ARM.forward(q)[1] + (bow(q) if what == "bow" else 0.0)


def readings(n: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform(-RANGE, RANGE, (n, len(ARM.joints)))


@cache
def calibrated(what: str, n: int = 60, seed: int = 1) -> Calibration:
    """The offsets of an arm with an error that they cannot describe."""
    q = readings(n, seed)
    seen = true_tip(what, q) + SCATTER * np.random.default_rng(seed + 50).standard_normal((n, 3))
    term = TrackedPoint.from_arrays(ARM, q, position=seen)
    free = (Selection(("*.offset",), bound_rad=0.2),)
    return calibrate(ARM, term, free=free, options=SolverOptions(starts=1))


@cache
def found(what: str, n: int = 60, seed: int = 1) -> ResidualMap:
    return residual_map(calibrated(what, n, seed), ResidualMapOptions(anyway=True))


def left(what: str, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """True errors (n, 3) of the calibrated tip in the base, without and with the map, m."""
    term = TrackedPoint.from_arrays(ARM, q, position=true_tip(what, q))
    of_truth = tip_residuals([term], ARM, found(what).values)
    assert of_truth is not None
    return of_truth.error, of_truth.error - found(what).correction(q)


@pytest.mark.parametrize(("what", "sort"), [("ripple", "joints"), ("bow", "posture")])
def test_an_error_that_no_parameter_describes_is_removed(what: str, sort: str) -> None:
    assert found(what).chosen is not None
    assert found(what).chosen.sort == sort
    before, after = left(what, readings(60, seed=9))
    assert np.sqrt(np.mean(after**2)) < 0.5 * np.sqrt(np.mean(before**2))
    assert "reduces the error of the tip" in str(found(what))
    assert len(repr(found(what)).splitlines()) <= 10


@pytest.mark.parametrize("what", ["ripple", "bow"])
def test_its_standard_deviation_is_true(what: str) -> None:
    q = readings(150, seed=9)
    _, after = left(what, q)
    measured = after + SCATTER * np.random.default_rng(3).standard_normal(after.shape)
    normalised = np.abs(measured) / np.hypot(found(what).std(q), found(what).noise)
    # Of an exact Gaussian 0.68 and 0.95; what is learnt from 60 rows is not exact.
    assert 0.6 < np.mean(normalised < 1) < 0.88
    assert np.mean(normalised < 2) > 0.92
    test = found(what).tried[0 if what == "ripple" else 1].tests[0]
    assert 0.6 < test.coverage(1.0, found(what).wider) < 0.85


@pytest.mark.parametrize("what", ["ripple", "bow"])
def test_far_from_the_data_nothing_is_corrected(what: str) -> None:
    far = np.full((1, len(ARM.joints)), 60.0)
    far[0, 0] += 1.0
    chosen = found(what).chosen
    assert chosen is not None
    near = found(what).std(readings(20, seed=9))
    assert np.linalg.norm(found(what).correction(far)) < 1e-6
    assert np.max(found(what).std(far)) > 2.0 * np.median(near)
    if what == "bow":
        unknown = chosen.process.unknown * found(what).wider
        assert found(what).std(far) == pytest.approx(unknown, rel=1e-3)


@pytest.mark.parametrize("seed", first_of([1, 2, 3]))
def test_noise_is_refused_with_the_figure(seed: int) -> None:
    nothing = found("noise", 40, seed)
    assert not nothing.used
    assert nothing.assessment.exit_code == 0
    assert "There is nothing left that a map can correct" in str(nothing)
    assert "mm RMS without a map" in nothing.assessment.sentence
    q = readings(3, seed=9)
    assert not nothing.correction(q).any()
    assert nothing.std(q) == pytest.approx(nothing.noise)
    assert correction_record(nothing) is None


@pytest.mark.slow
def test_noise_is_refused_in_nineteen_of_twenty_sets() -> None:
    used = sum(found("noise", 40, seed).used for seed in range(100, 160))
    assert used <= 3


def test_blocks_count_and_not_rows() -> None:
    """A gain in one block of many rows proves nothing."""
    before = np.full((40, 3), 1e-3)
    after = before.copy()
    after[:8] = 0.0
    block = np.arange(40) // 8
    one = LeftOut("time", block, before, after, before)
    assert one.p_value > 0.1
    assert not one.proven
    assert LeftOut("time", block, before, 0.5 * before * (1 + block[:, None] / 50), before).proven
    assert not LeftOut("time", block, before, 0.99 * before, before).proven


def module(text: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(text, "residual_map.py", "exec"), names)
    return names


def test_curves_of_joints_as_a_python_file() -> None:
    record = correction_record(found("ripple"))
    assert record is not None
    names, q = module(python_text(record)), readings(20, seed=9)
    wanted = found("ripple").corrected_readings(q)
    for row, want in zip(q, wanted, strict=True):
        got = names["corrected_readings"](dict(zip(ARM.joints, row.tolist(), strict=True)))
        assert [got[joint] for joint in ARM.joints] == pytest.approx(want, abs=2e-5)
    assert names["correction"](ARM.joints[0], 99.0)[0] == 0.0
    with pytest.raises(ValueError, match="expected a finite number"):
        names["correction"](ARM.joints[0], np.nan)
    # Turned right, the joints put the tip where the map does.
    tips = ARM.forward(wanted, found("ripple").values)[1]
    assert tips == pytest.approx(found("ripple").tip(q), abs=5e-6)
    rows = table_text(record).splitlines()
    assert rows[0] == "joint,unit,reading,correction,std"
    assert len(rows) == 1 + sum(len(curve["reading"]) for curve in record["curves"])


def test_what_must_be_applied_with_the_map() -> None:
    """A URDF holds no eccentricity: with calibrated.urdf alone the map is not right."""
    of_geometry = found("ripple")
    assert not of_geometry.beside
    assert of_geometry.assessment.level == "good"
    eccentric = "joint_2.ecc_c1"
    both = replace(of_geometry, values={**of_geometry.values, eccentric: 1e-3})
    assert both.assessment.level == "care"
    (note,) = both.assessment.notes[:1]
    assert note.startswith("residual_map.py does not correct calibrated.urdf alone")
    assert eccentric in note
    off = both.arm.forward(both.residuals.q, both.values)[1]
    off = off - both.arm.forward(both.residuals.q, of_geometry.values)[1]
    assert f"{1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))):.3f} mm (RMS" in note
    record = correction_record(both)
    assert record is not None
    text = python_text(record)
    assert f"It was found beside parameters that no URDF holds: {eccentric}." in text
    assert module(text)["correction"](ARM.joints[0], 99.0)[0] == 0.0


def test_a_map_over_posture_as_a_python_file() -> None:
    record = correction_record(found("bow"))
    assert record is not None
    names, q = module(python_text(record)), readings(20, seed=9)
    wanted, std = found("bow").correction(q), found("bow").std(q)
    for row, want, plus_minus in zip(q, wanted, std, strict=True):
        at = dict(zip(ARM.joints, row.tolist(), strict=True))
        assert names["tip_correction"](at) == pytest.approx(want, abs=1e-7)
        # From fewer postures: too large rather than too small.
        assert 0.95 * plus_minus[0] < names["std"](at) < 2.0 * plus_minus[0]
    rows = table_text(record).splitlines()
    assert rows[0].endswith("dx,dy,dz,std")
    with pytest.raises(InputError, match="a map of the joints"):
        found("bow").corrected_readings(q)


def test_what_cannot_be_used_is_refused() -> None:
    result = calibrated("ripple")
    with pytest.raises(SamplesError, match=r"29 rows .* at least 30"):
        residual_map(calibrated("noise", 29), ResidualMapOptions(anyway=True))
    with pytest.raises(SamplesError, match="finite readings"):
        found("ripple").correction(np.full((2, len(ARM.joints)), np.nan))
    with pytest.raises(SamplesError, match="readings of shape"):
        found("ripple").correction(np.zeros((2, 3)))
    bad = replace(result)
    object.__setattr__(bad, "assessment", Assessment.of("", bad=["It is worse."]))
    with pytest.raises(UnusableResultError, match="It is worse"):
        residual_map(bad)


def test_observations_that_do_not_see_the_tip_are_refused() -> None:
    scene = range_scene(ARM, {}, measured=True)
    term = scene.exact()
    with pytest.raises(SamplesError, match=r"no observation that gives the position .*\(range\)"):
        fitted_residuals([term], ARM, {}, 0)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("suta_calib.optional_packages.find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"pip install 'suta_calib\[maps\]'"):
        residual_map(calibrated("ripple"))


def rippling_job(folder: Path) -> Path:
    """The job of a simulated arm whose first two joints ripple."""
    job = write_simulated_job(folder, SUTA_URDF)
    turn = Rotation.from_rotvec([0.1, -0.4, 1.2]).as_matrix()
    for name, n, seed in (("calibration", 60, 1), ("validation", 25, 2)):
        q = readings(n, seed)
        noise = NOISE * np.random.default_rng(seed).standard_normal((n, 3))
        seen = ARM.forward(ripple(q), TRUTH)[1] @ turn.T + [1.0, -0.5, 0.3] + noise
        samples = Samples.from_arrays(ARM.joints, q, position=seen)
        write_samples(job.parent / name / "a.csv", samples)
    return job


def test_the_command_writes_a_correction_that_export_repeats(tmp_path: Path) -> None:
    job = rippling_job(tmp_path)
    cli("calibrate", job)
    results = tmp_path / "results"
    told = answer("residual-map", results, "--anyway")
    assert told["used"]
    assert {"residual_map.py", "residual_map.csv", "residual_map.json"} < set(told["files"])
    assert told["validation"][0]["after_rms_mm"] < 0.6 * told["validation"][0]["before_rms_mm"]
    assert {row["by"] for row in told["tests"] if row["sort"] == "joints"} == {"posture", "time"}
    for form, file in (("residual-map", "residual_map.py"), ("residual-table", "residual_map.csv")):
        out = tmp_path / f"again_{file}"
        command = ("export", results, "--format", form, "--out", out, "--anyway")
        assert cli(*command) == 0
        assert out.read_bytes() == (results / file).read_bytes()
        assert not out.with_name(f"{out.name}.left_out.json").exists()
    path = results / "residual_map.json"
    other = json.loads(path.read_text())
    name = next(iter(other["correction"]["parameters"]))
    other["correction"]["parameters"][name] += 1e-3
    path.write_text(json.dumps(other))
    assert "a residual map of another calibration" in refused(*command)
    path.unlink()
    assert "run suta-calib residual-map on the job first" in refused(*command)


def test_the_command_says_that_nothing_is_left(tmp_path: Path) -> None:
    job = write_simulated_job(tmp_path, SUTA_URDF)
    told = answer("residual-map", job, "--out", tmp_path / "out")
    assert not told["used"]
    assert told["correction"] is None
    assert told["verdict"]["sentence"].startswith("There is nothing left that a map can correct")
    assert "residual_map.py" not in told["files"]
    cli("calibrate", job)
    (tmp_path / "results/residual_map.json").write_text(json.dumps(told))
    command = ("export", tmp_path / "results", "--format", "residual-map")
    assert "nothing was left to correct" in refused(*command)
    samples = tmp_path / "calibration/a.csv"
    text = samples.read_text().splitlines()
    samples.write_text("\n".join([*text[:21], ""]))
    assert "20 rows with the position of the tip" in refused("residual-map", job, "--anyway")
    samples.write_text("\n".join([*text[:5], "nan" + text[5][text[5].index(",") :], *text[6:]]))
    assert "a.csv" in refused("residual-map", job, "--anyway")


def test_a_picture_of_either_sort_and_of_none() -> None:
    for left_over in (found("ripple"), found("bow"), found("noise", 40)):
        figure = left_over.plot()
        assert len(figure.axes) >= 2 + len(left_over.curves)


@pytest.mark.slow
def test_the_measured_ur5_is_at_a_twentieth_of_a_millimetre(repository: Path) -> None:
    """Poses that were never fitted: 0.085 and 0.087 mm mean without a map."""
    job = repository / "examples/ur5_laser_tracker/calibration_eccentric.yaml"
    left_over = residual_map(calibrate(job))
    assert left_over.chosen is not None
    assert left_over.chosen.sort == "joints"
    random, grid = (rows.metrics[1].mean for rows in left_over.chosen.validated)
    assert random < 0.068e-3
    assert grid < 0.056e-3
