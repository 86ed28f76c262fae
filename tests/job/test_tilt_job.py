"""Tilt sensors in a job: the answer comes back, and what is wrong with them is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies import first_of

from suta_calib import ArmModel, TrackedPoint, solve
from suta_calib.errors import InputError
from suta_calib.exchange import read_result
from suta_calib.exchange.writer import write_foreign
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.job import CalibrationJob
from suta_calib.job.calibration import Calibration
from suta_calib.model.tilt import is_share
from suta_calib.simulation import read_simulation, simulate
from suta_calib.solver.felt_noise import felt_noise_error
from suta_calib.terms import ArmPoses, Setup
from suta_calib.tracking.uncertainty import read_uncertainty
from tests.support.cli_job import answer
from tests.support.column_robot import (
    GROUND,
    MOUNTS,
    STATION,
    Measured,
    built,
    column_robot,
    column_robot_urdf,
    measured,
    tracked,
    written,
)

NOISE = 2e-4


@pytest.fixture(scope="module")
def sets() -> dict[str, Measured]:
    rng = np.random.default_rng(0)
    values = built(rng)
    one = measured(rng, 150, values, noise=NOISE)
    other = measured(rng, 60, values, noise=NOISE, station=STATION + np.array([1.0, 2.0, 0.1]))
    return {"one": one, "other": other}


@pytest.fixture(scope="module")
def result(sets: dict[str, Measured], tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    return CalibrationJob.load(written(tmp_path_factory.mktemp("tilt"), sets)).run()


def test_a_robot_that_sinks_is_as_good_as_its_instruments(result: Calibration) -> None:
    errors = result.metrics["validation"]["after"]
    # The noise of three coordinates, and that of two sensors at the end of some two metres.
    assert errors.rms < 1.5 * np.sqrt(3 * NOISE**2 + 2 * (2.5 * 1e-4) ** 2)
    estimates = result.estimates
    for link, share in (("base_link", GROUND.base_share), ("column", GROUND.column_share)):
        found = estimates[f"tilt[{link}].share"]
        assert found.std is not None
        assert found.std < 0.1
        assert abs(found.value - share) < 4 * found.std


def test_without_its_sensors_it_is_not(sets: dict[str, Measured], tmp_path: Path) -> None:
    plain = CalibrationJob.load(written(tmp_path, sets, sensors=False)).run()
    assert plain.metrics["validation"]["after"].rms > 3e-3
    wanted = (
        "tilt_sensors: [{link: base_link, columns: [base_link_ax, base_link_ay, base_link_az]}]"
    )
    assert any(wanted in note for note in plain.assessment.notes), plain.assessment.notes


def changed(path: Path, name: str, old: str, new: str) -> Path:
    file = path.parent / name
    file.write_text(file.read_text().replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("link: column", "link: colum", r"tilt sensor on the link 'colum'.*did you mean 'column'"),
        ("link: column", "link: base_link", "two tilt sensors on base_link"),
        ("column_ax, ", "", "2 columns"),
        ("column_ax, ", "column_bx, ", r"column_bx"),
        ("column_ax, ", "swing.ax, column_ax, ", "4 columns"),
    ],
)
def test_refused(
    sets: dict[str, Measured], tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = changed(written(tmp_path, sets), "calibration.yaml", old, new)
    with pytest.raises(InputError, match=message):
        CalibrationJob.load(path)


def test_rows_without_a_reading_and_in_motion_are_told(
    sets: dict[str, Measured], tmp_path: Path
) -> None:
    path = written(tmp_path, sets)
    file = tmp_path / "one.csv"
    lines = file.read_text().splitlines()
    header = lines[0].split(",")
    at = header.index("base_link_ax")
    for row, factor in ((1, None), (2, 1.3), (3, 1 / 9.81)):
        cells = lines[row].split(",")
        cells[at : at + 3] = [
            "" if factor is None else repr(factor * float(c)) for c in cells[at : at + 3]
        ]
        lines[row] = ",".join(cells)
    file.write_text("\n".join(lines) + "\n")
    (term,) = CalibrationJob.load(path).observations
    missing, moved = term.poses.felt_doubts  # type: ignore[attr-defined]
    assert missing.startswith("1 of 150 rows")
    assert "no reading of the tilt sensor of base_link" in missing
    assert moved.startswith("In 2 of 150 rows")
    assert "1.3 times as much" in moved
    assert not term.poses.conditions["tilt"][:3, :3].any()  # type: ignore[attr-defined]


def test_a_sensor_that_hangs_upside_down(sets: dict[str, Measured], tmp_path: Path) -> None:
    turned = rotation_from_vector([np.pi, 0.0, 0.0])
    felt = {**sets["one"].felt, "base_link": sets["one"].felt["base_link"] @ turned}
    data = Measured(sets["one"].q, felt, sets["one"].position, sets["one"].lean)
    job = CalibrationJob.load(written(tmp_path, {"one": data}))
    result = job.problem().start()
    assert np.isfinite(result).all()
    mount = [p.nominal for n, p in job.parameters.items() if n.startswith("tilt[base_link].mount")]
    up = rotation_from_vector(mount) @ felt["base_link"].mean(axis=0) / 9.81
    assert up[2] > 0.99


def test_readings_of_one_rest_are_averaged(sets: dict[str, Measured]) -> None:
    data, rng = sets["one"], np.random.default_rng(5)
    twice = Measured(
        np.repeat(data.q, 2, axis=0),
        {link: np.repeat(felt, 2, axis=0) for link, felt in data.felt.items()},
        np.repeat(data.position, 2, axis=0),
        data.lean,
    )
    noisy = {
        link: felt + 0.01 * rng.standard_normal(felt.shape) for link, felt in twice.felt.items()
    }
    poses = tracked(column_robot(), Measured(twice.q, noisy, twice.position, data.lean)).poses
    assert isinstance(poses, ArmPoses)
    told = poses.conditions["tilt"]
    np.testing.assert_array_equal(told[::2], told[1::2])
    exact = tracked(column_robot(), twice).poses
    assert isinstance(exact, ArmPoses)
    off = told - exact.conditions["tilt"]
    # Of two readings in m/s², against gravity.
    assert np.std(off[:, :2]) < 1.2 * 0.01 / 9.81 / np.sqrt(2)


def test_a_result_is_validated_exported_and_not_tracked(
    result: Calibration, sets: dict[str, Measured], tmp_path: Path
) -> None:
    job, out = written(tmp_path, sets), tmp_path / "results"
    assert any("sensors of base_link, column move the tip" in n for n in result.assessment.notes)
    answer("calibrate", job, "--out", out)
    urdf, record = out / "calibrated.urdf", out / "result.json"
    found = answer("validate", urdf, job, "--result", record)["metrics"]["validation"]["after"]
    rms = result.metrics["validation"]["after"].rms
    assert abs(found["rms_mm"] - 1e3 * rms) < 0.01
    mapped = answer("tip-map", job)["verdict"]["notes"]
    assert any("without the tilt sensors of base_link, column" in note for note in mapped)
    read = read_result(out)
    exported = write_foreign(read, "urdf")
    assert "tilt[column].share" in exported.lost
    with pytest.raises(InputError, match="tilt sensors correct this arm"):
        read_uncertainty(record, ArmModel.from_urdf(urdf, "tip"))


def test_simulated_by_a_file_it_comes_back(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(column_robot_urdf())
    (tmp_path / "simulation.yaml").write_text(SIMULATION)
    simulated = simulate(read_simulation(tmp_path / "simulation.yaml"))
    (file,) = simulated.files
    arm = simulated.arm
    assert isinstance(arm, ArmModel)
    term = TrackedPoint.over(ArmPoses(arm, file.samples), Setup())
    job = CalibrationJob.of_terms(arm, term, free=["joint_2.offset"])
    found = solve(job.problem(), job.options()).estimates
    for name, true in (("tilt[base_link].share", 0.1), ("tilt[column].share", 0.8)):
        std = found[name].std
        assert std is not None
        assert std < 0.05
        assert abs(found[name].value - true) < 4 * std
    assert abs(found["joint_2.offset"].value - 0.01) < 1e-3


SIMULATION = """\
arm:
  urdf: robot.urdf
  tip: tip
  tilt_sensors:
    - {link: base_link, columns: [base_ax, base_ay, base_az], rotation_rpy_deg: [0, 0, 0]}
    - {link: column, columns: [mast_ax, mast_ay, mast_az], rotation_rpy_deg: [0, 0, 0]}
errors:
  - {select: joint_2.offset, value_deg: 0.573}
  - {select: "tilt[base_link].share", value: -0.4}
  - {select: "tilt[column].share", value: 0.3}
noise: {instrument_mm: 0.1, tilt_deg: 0.002}
sets:
  seen:
    kind: tracked_point
    samples: 80
    lean_deg: 0.1
    base_in_instrument: {position_mm: [4000, 0, 0]}
"""


@pytest.mark.parametrize("felt_noise", first_of([2e-5, 1e-4]))
def test_shares_and_turns_are_as_sure_as_they_say(felt_noise: float) -> None:
    """Over eight robots, with sensors that are averaged at rest, or read once.

    Forty robots whose sensors are read once: shares are off by 0.99 and 1.03 of their ±, of which
    noise in the derivatives is most (1.5 and 1.3 without it).
    """
    truth = {
        "tilt[base_link].share": GROUND.base_share,
        "tilt[column].share": GROUND.column_share,
        "tilt[column].turn": float(MOUNTS["column"][2]),
    }
    off, biases = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        data = measured(rng, 100, built(rng), felt_noise=felt_noise)
        arm = column_robot()
        job = CalibrationJob.of_terms(arm, tracked(arm, data))
        solution = solve(job.problem(), job.options())
        found = solution.estimates
        bias = felt_noise_error(solution.spread.fit)
        shares = [solution.problem.names.index(name) for name in truth if is_share(name)]
        biases.append(bias[shares])
        off.append(
            [(found[n].value - true) / (found[n].std or np.inf) for n, true in truth.items()]
        )
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all(spread > 0.3), spread
    assert np.all(spread < 2.0), spread
    # Noise makes a base seem to turn higher, and its column lower.
    base, column = np.mean(biases, axis=0)
    assert (base > 0.02 and column < -0.01) if felt_noise > 5e-5 else abs(base) < 0.01
