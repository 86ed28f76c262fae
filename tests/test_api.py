"""One call from Python: arms and observations without files, and one judged answer."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulated import arm_named, dh_parameters
from terms_cases import AVAILABLE, problem_of

from suta_calib import (
    ArmModel,
    Artefact,
    Calibration,
    CalibrationJob,
    Camera,
    GivenPose,
    InputError,
    Landmark,
    Noise,
    ParameterSet,
    Problem,
    Selection,
    SolverOptions,
    SutaCalibError,
    UnusableResultError,
    calibrate,
    read_artefact,
    read_samples,
    solve,
)
from suta_calib.arrays import FloatArray
from suta_calib.errors import UrdfError
from suta_calib.geometry.numbers import quaternion_from_rotation, register_points
from suta_calib.job.in_python import Free
from suta_calib.terms import (
    KINDS,
    ArmPoses,
    CameraView,
    FixedPoint,
    HandEye,
    MeasuredRange,
    PairwiseDistance,
    Term,
    TouchedPlane,
    TrackedPoint,
)
from suta_calib.terms.from_arrays import attributes_of


def test_an_arm_is_read_from_the_text_of_a_urdf(suta_urdf: Path, tmp_path: Path) -> None:
    text = suta_urdf.read_text(encoding="utf-8")
    from_file = ArmModel.from_urdf(suta_urdf, "tip")
    q = np.full((1, len(from_file.joints)), 0.3)
    for given in (text, f"\ufeff{text}", f"\n  {text}"):
        arm = ArmModel.from_urdf(given, tip="tip")
        np.testing.assert_array_equal(arm.forward(q)[1], from_file.forward(q)[1])
        arm.write_urdf(tmp_path / "arm.urdf", {"joint_4.z": 0.58})
        from_file.write_urdf(tmp_path / "again.urdf", {"joint_4.z": 0.58})
        assert (tmp_path / "arm.urdf").read_bytes() == (tmp_path / "again.urdf").read_bytes()


def test_text_is_in_the_encoding_that_it_declares(suta_urdf: Path) -> None:
    text = suta_urdf.read_text(encoding="utf-8").replace('"tip"', '"Spitze_ä"')
    text = f'<?xml version="1.0" encoding="iso-8859-1"?>\n{text[text.index("<robot") :]}'
    assert "Spitze_ä".encode("latin-1") in ArmModel.from_urdf(text, "Spitze_ä").urdf[1]
    with pytest.raises(UrdfError, match="text of a URDF: found text that cannot be encoded"):
        ArmModel.from_urdf(text.replace("ä", "漢"), "Spitze_漢")


@pytest.mark.parametrize(
    ("given", "tip", "said"),
    [
        ("<robot", "tip", "the text of a URDF:1: found text that is not XML"),
        ("<robot name='a'></robot>", "tip", "the text of a URDF:1: found no <joint> in <robot>"),
        ("<sdf/>", "tip", "the text of a URDF:1: found the root element <sdf>"),
        ("no_such.urdf", "tip", "no_such.urdf: found no such file"),
        (b"<robot/>", "tip", "urdf: found bytes; expected the path or the text of a URDF"),
        (None, "tip", "urdf: found NoneType; expected the path or the text of a URDF"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_named(given: str, tip: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        ArmModel.from_urdf(given, tip)
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize("tip", ["tool", None, 7])
def test_a_tip_that_is_not_there_is_named(suta_urdf: Path, tip: str) -> None:
    with pytest.raises(UrdfError, match=r"the text of a URDF: tip: found '?(tool|None|7)"):
        ArmModel.from_urdf(suta_urdf.read_text(encoding="utf-8"), tip)


# ── observations from arrays ─────────────────────────────────────────────────────────────────
def arrays_of(term: Term) -> dict[str, Any]:
    """What a term was made of, as `from_arrays` takes it."""
    samples = term.poses.samples
    found = {
        "position": samples.position,
        "orientation": samples.rotation,
        "position_sigma": samples.position_sigma,
        "pixels": samples.pixels,
        "direction": samples.direction,
    }
    attributes = {name: getattr(term, name) for name in attributes_of(type(term))}
    known = {name: array for name, array in found.items() if array is not None}
    return {**attributes, **known, **samples.labels, **samples.numbers}


@pytest.mark.parametrize("name", AVAILABLE)
def test_every_kind_is_made_from_arrays(name: str) -> None:
    (term,) = problem_of(name).terms
    assert isinstance(term.poses, ArmPoses)
    again = type(term).from_arrays(term.poses.arm, term.poses.samples.q, **arrays_of(term))
    assert [p.name for p in again.own_parameters] == [p.name for p in term.own_parameters]
    for block, same in zip(term.blocks, again.blocks, strict=True):
        np.testing.assert_array_equal(block.samples, same.samples)
        np.testing.assert_allclose(block.data, same.data, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_help_shows_what_a_kind_takes(kind: type[Term]) -> None:
    constructor = kind.from_arrays
    taken = inspect.signature(constructor).parameters
    assert [*taken][:2] == ["arm", "q"]
    assert {*kind.columns.labels} <= {*taken}
    assert all(f"    {name}: " in str(constructor.__doc__) for name in kind.columns.labels)


ARM = arm_named("suta")
Q = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 6))
SEEN = ARM.forward(Q)[1]
WRONG: list[tuple[type[Term], dict[str, Any], str]] = [
    (TrackedPoint, {}, "tracked_point: found no position; expected position: (n, 3) in m"),
    (TrackedPoint, {"position": SEEN[:5]}, "position: found shape (5, 3); expected shape (12, 3)"),
    (TrackedPoint, {"position": SEEN * np.nan}, "position[0, 0]: found nan"),
    (TrackedPoint, {"position": SEEN * 1e9}, "coordinates of a grid, subtract an origin"),
    (TrackedPoint, {"position": "here"}, "position: found no array of numbers"),
    (TrackedPoint, {"position": SEEN + 1j}, "position: found no array of numbers"),
    (TrackedPoint, {"position": [[1, 2, 3], [4, 5]]}, "position: found no array of numbers"),
    (TrackedPoint, {"position": np.ma.masked_less(SEEN, 0.3)}, ": found nan; expected a finite"),
    (TrackedPoint, {"position": SEEN, "positon": SEEN}, "did you mean 'position'?"),
    (TrackedPoint, {"position": SEEN, "landmark": "A"}, "found the argument 'landmark'"),
    (TrackedPoint, {"position": SEEN, "target": ["A"] * 5}, "target: found 5 labels; expected 12"),
    (TrackedPoint, {"position": SEEN, "target": ["A"] * 11 + [None]}, "target[11]: found None"),
    (TrackedPoint, {"position": SEEN, "target": ["A"] * 11 + [""]}, "target[11]: found ''"),
    (TrackedPoint, {"position": SEEN, "orientation": np.ones((12, 4))}, "a quaternion of length 2"),
    (
        TrackedPoint,
        {"position": SEEN, "orientation": np.ones((12, 3))},
        "expected shape (12, 3, 3)",
    ),
    (TrackedPoint, {"position": SEEN, "position_sigma": -1e-4}, "a number greater than 0"),
    (TrackedPoint, {"position": SEEN, "noise": 1e-3}, "noise: found 0.001 (float); expected Noise"),
    (TrackedPoint, {"position": SEEN, "label": 3}, "label: found 3 (int); expected str"),
    (TrackedPoint, {"position": SEEN, "direction": Q}, "expected -1, 0 or 1"),
    (TrackedPoint, {"position": SEEN, "temperature": 293.0}, "expected °C, from -60 to 150"),
    (TrackedPoint, {"position": SEEN, "origin": ["a"]}, "origin: found 1 entries; expected 12"),
    (HandEye, {"position": SEEN}, "hand_eye: found no orientation"),
    (FixedPoint, {}, "fixed_point: found no point; expected point: a label for each row, or one"),
    (
        TouchedPlane,
        {"plane": "A", "radius": "thick"},
        "radius: found 'thick' (str); expected float",
    ),
    (TouchedPlane, {"plane": "A", "radius": -0.01}, "radius: found -0.01"),
    (MeasuredRange, {"anchor": "A", "length": np.zeros(12)}, "length[0]: found 0"),
    (PairwiseDistance, {"placement": 1, "repeat": 1, "landmark": "A"}, "found no artefact"),
    (
        PairwiseDistance,
        {"placement": 1, "repeat": 1, "landmark": "A", "artefact": "artefact.yaml"},
        "artefact: found 'artefact.yaml' (str); expected Artefact",
    ),
    (CameraView, {"pixels": np.ones((12, 3, 2))}, "camera_view: found no board"),
    (CameraView, {"pixels": np.ones((12, 3))}, "pixels: found shape (12, 3)"),
]


@pytest.mark.parametrize(("kind", "given", "said"), WRONG, ids=[said for _, _, said in WRONG])
def test_arrays_that_cannot_be_used_are_refused_in_words(
    kind: type[Term], given: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError) as refused:
        kind.from_arrays(ARM, Q, **given)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("q", "said"),
    [
        (np.degrees(Q), "looks like degrees: convert to radians"),
        (Q[:, :5], "tracked_point: q: found shape (12, 5); expected (n, 6)"),
        (Q[0], "tracked_point: q: found shape (6,)"),
        (Q[:0], "tracked_point: q: found no samples"),
        (Q * np.inf, "q[0, 0]: found"),
        (None, "q: found"),
    ],
)
def test_readings_that_cannot_be_used_are_refused_in_words(q: Any, said: str) -> None:
    with pytest.raises(InputError) as refused:
        TrackedPoint.from_arrays(ARM, q, position=SEEN)
    assert said in str(refused.value)


def test_an_arm_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"arm: found 'arm.urdf' \(str\); expected an ArmModel"):
        TrackedPoint.from_arrays("arm.urdf", Q, position=SEEN)


def test_quaternions_are_x_y_z_w() -> None:
    turned = ARM.forward(Q)[0]
    by_matrix, by_quaternion = (
        HandEye.from_arrays(ARM, Q, position=SEEN, orientation=orientation)
        for orientation in (turned, quaternion_from_rotation(turned))
    )
    np.testing.assert_allclose(
        by_matrix.poses.samples.rotation, by_quaternion.poses.samples.rotation, atol=1e-12
    )


def test_one_label_stands_for_all_rows() -> None:
    term = FixedPoint.from_arrays(ARM, Q, point="post")
    assert term.places[0] == ["post"]


# ── one call ─────────────────────────────────────────────────────────────────────────────────
TRUTH = {"joint_2.offset": 0.02, "joint_3.offset": -0.03, "joint_4.z": 0.574, "joint_5.ry": 0.004}


def seen(rows: int, seed: int, *, backwards: str = "", label: str = "default") -> TrackedPoint:
    """An arm with errors, seen by an instrument; perhaps with a joint that counts backwards."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.2, 1.2, (rows, 6))
    turned = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    position = ARM.forward(q, TRUTH)[1] @ turned + [0.5, 0.2, 0.1]
    position += 1e-4 * random.standard_normal(position.shape)
    q *= [-1.0 if name == backwards else 1.0 for name in ARM.joints]
    return TrackedPoint.from_arrays(ARM, q, position=position, label=label)


@pytest.fixture(scope="module")
def result() -> Calibration:
    return calibrate(ARM, [seen(50, 1)], validation=[seen(25, 2)])


def test_an_answer_without_files_is_judged(result: Calibration) -> None:
    assert (result.assessment.level, result.assessment.usable) == ("good", True)
    assert result.assessment.sentence.startswith("converged: ")
    assert (
        result.metrics["validation"]["after"].rms
        < 3e-4
        < result.metrics["validation"]["before"].rms
    )
    assert result.metrics["calibration"]["after"].count == 50


def test_its_estimates_and_covariance_go_together(result: Calibration) -> None:
    found = result.estimates["joint_5.ry"]
    assert found.std is not None
    assert abs(found.value - TRUTH["joint_5.ry"]) < 4 * found.std
    place = [*result.estimates].index("joint_5.ry")
    assert result.covariance[place, place] == pytest.approx(found.std**2)


def test_its_arm_and_its_urdf_are_the_calibrated_one(result: Calibration, tmp_path: Path) -> None:
    result.write_urdf(tmp_path / "calibrated.urdf")
    written = ArmModel.from_urdf(tmp_path / "calibrated.urdf", "tip")
    np.testing.assert_allclose(written.forward(Q)[1], result.arm.forward(Q)[1], atol=1e-9)
    truth = ARM.forward(Q, TRUTH)[1]
    aligned = registered_residual(result.arm.forward(Q)[1], truth)
    assert aligned < 5e-4 < registered_residual(SEEN, truth)


def registered_residual(points: FloatArray, others: FloatArray) -> float:
    """RMS after the rigid motion that an instrument of unknown place leaves open, m."""
    R, p = register_points(points, others)
    return float(np.sqrt(np.mean(np.sum((points @ R.T + p - others) ** 2, axis=1))))


@pytest.mark.parametrize("joint", ["joint_3", "joint_6"])
def test_a_joint_that_counts_backwards_writes_no_urdf(joint: str, tmp_path: Path) -> None:
    terms = seen(50, 1, backwards=joint), seen(25, 2, backwards=joint)
    result = calibrate(ARM, terms[0], validation=terms[1])
    assert result.assessment.level == "bad"
    assert f"{joint} counts the other way" in result.assessment.notes[0]
    with pytest.raises(UnusableResultError, match=rf"{joint} counts.*use it with anyway=True"):
        result.write_urdf(tmp_path / "arm.urdf")
    assert not [*tmp_path.iterdir()]
    result.write_urdf(tmp_path / "arm.urdf", anyway=True)
    assert (tmp_path / "arm.urdf").is_file()


def test_a_solution_is_judged_when_it_is_asked() -> None:
    solution = solve(Problem([seen(40, 1, backwards="joint_3")], dh_parameters(ARM)))
    assert solution.assessment.level == "bad"
    assert "joint_3 counts the other way" in solution.assessment.notes[0]
    assert solution.assessment is solution.assessment


def test_a_job_is_run_by_the_same_call(repository: Path) -> None:
    path = repository / "data" / "suta" / "calibration.yaml"
    by_path, by_job = calibrate(path), calibrate(CalibrationJob.load(path))
    assert isinstance(by_path, Calibration)
    assert by_path.solution.values == by_job.solution.values
    with pytest.raises(InputError, match="calibrate: found a job and more arguments"):
        calibrate(path, free="*.offset")


@pytest.mark.parametrize(
    ("free", "count"),
    [
        ("*.offset", 6),
        (["*.offset", "joint_4.z"], 7),
        (Selection("joint_?.offset", bound_rad=0.1), 6),
        (ARM.select("joint_4.z"), 1),
        ("geometric", 6 * 6 + 6),
    ],
)
def test_what_is_free_is_chosen_as_in_a_job(free: Free, count: int) -> None:
    job = CalibrationJob.of_terms(ARM, [seen(20, 1)], free=free)
    assert len(job.parameters) == count
    for parameter in job.parameters.values():
        stated = isinstance(free, ParameterSet | Selection)
        assert (parameter.prior is None) == stated
        assert parameter.prior_assumed != stated


def test_a_report_and_a_plot_need_no_files(result: Calibration, tmp_path: Path) -> None:
    result.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Calibration of" in page
    assert "joint_5.ry" in page
    assert result.plot() is not None
    assert result.calibrated.title


WRONG_CALLS: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
    ((ARM,), {}, "calibrate: found no observations"),
    ((ARM, []), {}, "calibrate: found no observations"),
    ((ARM, None), {}, "calibrate: terms: found None; expected terms"),
    ((ARM, [SEEN]), {}, "expected a term; make one with from_arrays"),
    (
        (3, [seen(9, 1)]),
        {},
        "found int; expected an ArmModel, a Robot, a CalibrationJob, or the path",
    ),
    (("no.yaml",), {}, "no.yaml"),
    ((ARM, seen(2, 1)), {}, "found 2 samples; expected at least 3"),
    ((ARM.at({"joint_4.z": 0.6}), seen(9, 1)), {}, "of another ArmModel; expected this arm"),
    ((ARM, seen(9, 1)), {"free": "joint_9.z"}, "'joint_9.z', which matches no parameter"),
    ((ARM, seen(9, 1)), {"free": [7]}, "calibrate: free: found 7; expected names, globs"),
    ((ARM, seen(9, 1)), {"free": 7}, "calibrate: free: found 7; expected names, globs"),
    ((ARM, seen(9, 1)), {"free": []}, "calibrate: free: found nothing to estimate"),
    ((ARM, seen(9, 1)), {"options": 8}, "options: found 8; expected SolverOptions"),
    ((ARM, seen(9, 1)), {"validation": 1.0}, "calibrate: validation: found 1.0; expected terms"),
    ((ARM, [seen(9, 1), seen(9, 1)]), {}, "9 samples that are in observations[0] too"),
]


@pytest.mark.parametrize(("given", "more", "said"), WRONG_CALLS)
def test_a_call_that_cannot_work_is_refused_in_words(
    given: tuple[Any, ...], more: dict[str, Any], said: str
) -> None:
    with pytest.raises(SutaCalibError) as refused:
        calibrate(*given, **more)
    assert said in str(refused.value)


def test_positions_in_mm_are_refused() -> None:
    term = seen(20, 1)
    position = 1e3 * np.asarray(term.poses.samples.position)
    in_mm = TrackedPoint.from_arrays(ARM, term.poses.samples.q, position=position)
    with pytest.raises(InputError, match="is the unit right"):
        calibrate(ARM, in_mm)


UNUSABLE: list[tuple[Callable[[], Any], str]] = [
    (lambda: Noise(sigma=math.nan), "Noise: sigma: found nan; expected a number greater than"),
    (lambda: Noise(huber="x"), "Noise: huber: found 'x'"),
    (lambda: Selection("*.offset", prior_rad=0.0), "parameters: prior_rad: found 0.0"),
    (lambda: Selection("*.offset", bound_rad=math.nan), "parameters: bound_rad: found nan"),
    (lambda: Selection(5), "parameters: select: found 5"),
    (lambda: SolverOptions(starts=1.5), "SolverOptions: starts: found 1.5; expected a whole"),
    (lambda: SolverOptions(hessian="none"), "expected gauss-newton or exact"),
    (lambda: GivenPose("here"), "GivenPose: position: found no array of numbers"),
    (lambda: GivenPose([0, 0, 0], np.ones((3, 3))), "found a matrix that is not a rotation"),
    (lambda: Landmark("A", [1, 2]), "landmark A: position: found shape (2,)"),
    (lambda: Artefact("a", ["A"]), "artefact 'a': found 'A'; expected landmarks"),
    (lambda: Camera(10, 10, [1.0]), "camera: intrinsics: found shape (1,)"),
    (lambda: ArmPoses(ARM, SEEN), "ArmPoses: found ArmModel, ndarray; expected an ArmModel and"),
    (lambda: Problem([SEEN]), "expected a term"),
    (lambda: Problem([seen(9, 1)], "geometric"), "Problem: found 'geometric'; expected parameters"),
    (lambda: FixedPoint.from_arrays(ARM, Q, point="A", given={"A": 1}), "expected GivenPose"),
    (lambda: FixedPoint.from_arrays(ARM, Q, point="A", given=[1]), "given: found [1] (list)"),
    (lambda: ARM.forward("x"), "found no readings"),
    (lambda: read_samples("no.csv", (), TrackedPoint.columns), "no.csv: found no such file"),
    (lambda: read_artefact("no.yaml"), "no.yaml: found no such file"),
]


@pytest.mark.parametrize(("make", "said"), UNUSABLE, ids=[said for _, said in UNUSABLE])
def test_what_cannot_be_used_is_refused_where_it_is_made(
    make: Callable[[], Any], said: str
) -> None:
    with pytest.raises(InputError) as refused:
        make()
    assert said in str(refused.value)


def test_positions_that_never_move_are_refused() -> None:
    still = TrackedPoint.from_arrays(ARM, Q, position=np.zeros((12, 3)))
    with pytest.raises(InputError, match="positions that scatter by 0 mm about"):
        calibrate(ARM, still)


def test_a_landmark_artefact_and_pose_take_plain_lists() -> None:
    artefact = Artefact("bar", [Landmark("A", [0, 0, 0]), Landmark("B", [0, 0, 0.1])])
    assert [*artefact.landmarks] == ["A", "B"]
    assert GivenPose([0, 0, 1], position_std=1e-3).position_std == pytest.approx([1e-3] * 3)
