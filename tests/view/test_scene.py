"""Scenes of a calibration, in no library's words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_job import write_simulated_job
from simulated import ARMS, SUTA_URDF, arm_named, perturbed, random_readings
from terms_cases import each_case, problem_of, truth_of

from suta_calib.assessment import Assessment
from suta_calib.errors import SutaCalibWarning
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import Samples, write_samples
from suta_calib.measurements.samples import joined
from suta_calib.model.arm import ArmModel
from suta_calib.plotting.look import MOST_ARROWS
from suta_calib.plotting.scene import largest_of_regions
from suta_calib.terms import Term
from suta_calib.view.calibrated import Calibrated
from suta_calib.view.calibration import TipErrors, calibration_scene
from suta_calib.view.drawn_arm import DrawnArm
from suta_calib.view.meshes import found_file, link_meshes
from suta_calib.view.scene import (
    ArmScene,
    Ellipsoids,
    ErrorVectors,
    Frustum,
    Patch,
    PointCloud,
    Stroke,
)
from suta_calib.view.server import legend


def shown(term: Term, values: dict[str, float]) -> Calibrated:
    arm = term.poses.arm
    names = tuple(list(arm.parameters)[:3])
    covariance = np.diag([1e-8, 4e-8, 9e-8])
    terms = {"calibration": ((term, values),)}
    return Calibrated("job", arm, values, names, covariance, terms, {}, Assessment("good"))


@pytest.mark.parametrize("name", ARMS)
def test_links_are_where_kinematics_has_them(name: str) -> None:
    arm, rng = arm_named(name), np.random.default_rng(0)
    values = perturbed(arm.parameters, seed=2)
    drawn = DrawnArm("calibrated", arm, values)
    tip = drawn.links.index(arm.chain.tip_link)
    for q in random_readings(arm, rng, 5):
        rotation, position = drawn.poses(q)
        R, p = arm.forward(q, values)
        np.testing.assert_allclose(position[tip], p, atol=1e-9)
        np.testing.assert_allclose(rotation[tip], R, atol=1e-9)
        np.testing.assert_allclose(position[drawn.links.index(arm.chain.base)], 0, atol=1e-12)


def test_of_two_arms_that_hold_one_thing_the_base_is_a_hand() -> None:
    legs = ArmModel.from_urdf(arm_named("tiago").chain.path, "arm_tool_link", "head_2_link")
    drawn = DrawnArm("nominal", legs, {})
    (q,) = random_readings(legs, np.random.default_rng(0), 1)
    _, position = drawn.poses(q)
    tip = position[drawn.links.index("arm_tool_link")]
    np.testing.assert_allclose(tip, legs.forward(q)[1], atol=1e-9)
    assert drawn.bones.shape == (len(legs.chain.joints), 2)


@each_case
def test_every_kind_can_be_seen(name: str) -> None:
    problem = problem_of(name)
    (term,), values = problem.terms, problem.values(truth_of(problem, name))
    scene = calibration_scene(shown(term, values))
    names = [thing.name for thing in scene.things]
    assert len(names) == len(set(names))
    (arrows,) = (t for t in scene.things if isinstance(t, ErrorVectors))
    errors = TipErrors("calibration", term, values, arrows.at, arrows.vector)
    for factor in (1.0, 40.0):
        begin, end = np.moveaxis(arrows.ends(factor), 1, 0)
        lengths = np.linalg.norm(end - begin, axis=1)
        np.testing.assert_allclose(lengths, factor * errors.norm, rtol=1e-9)
    # An arrow ends, drawn once as long, where the arm has the tip.
    _, tips = term.poses.at(values)
    ends = arrows.ends(1.0)[:, 1]
    if len(tips) > len(ends):
        # Of many, the largest of each region are drawn.
        tips = tips[np.argmin(np.linalg.norm(ends[:, None] - tips, axis=2), axis=1)]
    np.testing.assert_allclose(ends, tips, atol=1e-9)
    assert len(scene.rows) == len(term.poses)
    assert np.isfinite(scene.extent).all()
    stands = [t for t in scene.things if not isinstance(t, (ErrorVectors, Ellipsoids))]
    assert stands or not (term.place_unknown or term.mark or term.frames)


def test_ellipsoids_are_the_covariance_of_the_tip() -> None:
    problem = problem_of("tracked_point")
    (term,), values = problem.terms, problem.values(truth_of(problem, "tracked_point"))
    calibrated = shown(term, values)
    (found,) = (t for t in calibration_scene(calibrated).things if isinstance(t, Ellipsoids))
    q = term.poses.samples.q[:1]
    _, covariance = calibrated.tip(calibrated.arm, q)
    axes = found.turn[0] * found.std[0]
    np.testing.assert_allclose(axes @ axes.T, covariance[0], atol=1e-14)
    assert np.linalg.det(found.turn[0]) == pytest.approx(1.0)
    step = 1e-6
    jacobian = [
        (term.poses.arm.forward(q, {**values, n: values.get(n, p.nominal) + step})[1]
         - term.poses.arm.forward(q, {**values, n: values.get(n, p.nominal) - step})[1])[0]
        / (2 * step)
        for n, p in list(term.poses.arm.parameters.items())[:3]
    ]  # fmt: skip
    J = np.array(jacobian).T
    np.testing.assert_allclose(covariance[0], J @ calibrated.covariance @ J.T, atol=1e-13)


def test_of_many_errors_the_largest_of_each_region_is_drawn() -> None:
    rng = np.random.default_rng(0)
    places, sizes = rng.uniform(0.0, 1.0, (1000, 3)), rng.uniform(0.0, 1.0, 1000)
    rows = largest_of_regions(places, sizes)
    assert 30 <= len(rows) <= MOST_ARROWS
    assert np.argmax(sizes) in rows
    # Regions are all over, and no two rows are of the same.
    assert np.ptp(places[rows], axis=0).min() > 0.8
    assert len(np.unique(rows)) == len(rows)
    np.testing.assert_array_equal(largest_of_regions(places[:9], sizes[:9]), np.arange(9))
    assert len(largest_of_regions(np.zeros((1000, 3)), sizes)) == 1
    few = ErrorVectors(
        "errors/calibration", places[rows], places[rows], np.zeros((len(rows), 3)), 1000
    )
    scene = ArmScene("t", (), np.zeros(0), (few,))
    assert f"({len(rows)} of 1,000: the largest error in each region)" in legend(scene)


@pytest.mark.parametrize(
    ("name", "kind"), [("plane", Patch), ("line", Stroke), ("camera_view", Frustum)]
)
def test_what_was_touched_or_sees_is_there(name: str, kind: type) -> None:
    problem = problem_of(name)
    (term,), values = problem.terms, problem.values(truth_of(problem, name))
    found = [t for t in calibration_scene(shown(term, values)).things if isinstance(t, kind)]
    assert found
    if isinstance(found[0], Patch):
        # Every corner is on the plane: in the frame of the plane, at no height.
        places = term.outside
        heights = [
            ((patch.corners - p) @ R)[:, 2]
            for patch, (R, p) in zip(found, (f.pose(values) for f in places), strict=True)
        ]
        np.testing.assert_allclose(heights, 0.0, atol=1e-9)
    if isinstance(found[0], Frustum):
        assert found[0].carrier == term.poses.arm.chain.tip_link
        assert found[0].field_of_view < np.pi


@pytest.mark.parametrize("name", ["plane_view", "plane_view of planes on the tip"])
def test_planes_that_were_seen_are_drawn_where_the_points_were(name: str) -> None:
    problem = problem_of(name)
    (term,), values = problem.terms, problem.values(truth_of(problem, name))
    things = calibration_scene(shown(term, values)).things
    patches = {t.name: t for t in things if isinstance(t, Patch)}
    tip = term.poses.arm.chain.tip_link
    for plane in term.outside[1:]:
        patch = patches[f"planes/{plane.owner[6:-1]} seen"]
        assert patch.carrier == (tip if plane.within == "tip" else "")
        rotation, position = plane.pose(values)
        np.testing.assert_allclose(((patch.corners - position) @ rotation)[:, 2], 0.0, atol=1e-9)
        assert np.linalg.norm(np.ptp(patch.corners, axis=0)) > 0.01


def test_an_artefact_stands_where_its_landmarks_were_touched() -> None:
    problem = problem_of("landmark")
    (term,), values = problem.terms, problem.values(truth_of(problem, "landmark"))
    scene = calibration_scene(shown(term, values))
    marks = {t.name: t for t in scene.things if isinstance(t, PointCloud)}
    labels = term.poses.samples.labels
    names, artefact = list(term.touched.landmarks), term.touched
    ideal = term.observed(values, term.poses).position
    for key in np.unique(joined(labels, ("placement", "landmark"))):
        placement, mark = str(key).split("/")
        row = np.flatnonzero(joined(labels, ("placement", "landmark")) == key)[0]
        there = marks[f"artefact/{placement} landmarks"].position[names.index(mark)]
        np.testing.assert_allclose(there, ideal[row], atol=1e-9)
    assert len(artefact.landmarks) == len(names)


def test_what_is_far_from_all_others_is_outlying(tmp_path: Path) -> None:
    job = write_simulated_job(tmp_path, SUTA_URDF)
    arm = ArmModel.from_urdf(job.parent / "arm.urdf", "tip")
    term = CalibrationJob.load(job).observations[0]
    position = term.poses.samples.position.copy()
    position[4] += 0.01
    file = job.parent / "calibration" / "a.csv"
    write_samples(file, Samples.from_arrays(arm.joints, term.poses.samples.q, position=position))
    job.write_text(job.read_text().replace("sigma_mm: 0.05}", "sigma_mm: 0.05, huber_mm: 0.1}"))
    scene = calibration_scene(CalibrationJob.load(job).run().calibrated)
    assert np.flatnonzero(scene.rows.outlying).tolist() == [4]
    assert scene.rows.names[4].startswith("calibration, a.csv:6, ")
    (arrows,) = (t for t in scene.things if t.name.startswith("errors/calibration"))
    odd = np.flatnonzero((arrows.colours != arrows.colours[0]).any(axis=1))
    assert odd.tolist() == [4]


def test_meshes_are_found_as_the_urdf_names_them(tmp_path: Path) -> None:
    package = tmp_path / "my_arm"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    mesh = package / "meshes" / "link.stl"
    mesh.write_text(
        "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
        "endloop\nendfacet\nendsolid s\n"
    )
    urdf = package / "urdf" / "arm.urdf"
    visual = (
        '<visual><origin xyz="0 0 0.5"/><geometry><mesh filename="{}" scale="2 2 2"/></geometry>'
        "</visual>"
    )
    urdf.write_text(
        '<robot name="r"><link name="a">'
        + visual.format("package://my_arm/meshes/link.stl")
        + '</link><link name="b">'
        + visual.format("package://elsewhere/none.stl")
        + '</link><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
        "</robot>"
    )
    (found,) = link_meshes(urdf, urdf.read_bytes())
    assert found.link == "a"
    np.testing.assert_allclose(found.vertices.min(axis=0), [0, 0, 0.5])
    np.testing.assert_allclose(found.vertices.max(axis=0), [2, 2, 0.5])
    assert found_file("../meshes/link.stl", urdf).resolve() == mesh.resolve()
    assert not found_file("package://elsewhere/none.stl", urdf).is_file()


WITH_SHAPE = (
    '<robot name="r"><link name="a"><visual>{}</visual></link><link name="b"><visual><geometry>'
    '<box size="1 2 3"/></geometry></visual></link><joint name="j" type="continuous">'
    '<parent link="a"/><child link="b"/></joint></robot>'
)


@pytest.mark.parametrize(
    ("file", "content"), [("a.dae", "<COLLADA/>"), ("a.dae", "no XML"), ("a.none", "?")]
)
def test_a_mesh_that_is_broken_is_named_and_left_out(
    tmp_path: Path, file: str, content: str
) -> None:
    (tmp_path / file).write_text(content)
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(WITH_SHAPE.format(f'<geometry><mesh filename="{file}"/></geometry>'))
    with pytest.warns(SutaCalibWarning, match=f"{file}: found no mesh"):
        (box,) = link_meshes(urdf, urdf.read_bytes())
    assert box.link == "b"
    np.testing.assert_allclose(np.ptp(box.vertices, axis=0), [1, 2, 3])


def test_shapes_that_make_no_sense_are_no_reason_to_show_nothing(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(WITH_SHAPE.format('<origin xyz="a b c"/><geometry><sphere/></geometry>'))
    with pytest.warns(SutaCalibWarning, match="shapes that cannot be drawn"):
        assert link_meshes(urdf, urdf.read_bytes()) == ()


def test_packages_of_ros_are_looked_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = tmp_path / "ws" / "share" / "pkg" / "m.stl"
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ws"))
    assert found_file("package://pkg/m.stl", tmp_path / "arm.urdf") == mesh
