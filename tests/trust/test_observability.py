"""What the data can tell is predicted, counted and explained rightly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated import (
    Scene,
    arm_named,
    artefact,
    artefact_scene,
    fixed_point_scene,
    hand_eye_scene,
    placements,
    random_readings,
)

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import register_points, rms_length
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Selection
from suta_calib.registry import shipped
from suta_calib.report.observability import explained
from suta_calib.solver.covariance import predicted_covariance
from suta_calib.solver.information import predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.terms import (
    KINDS,
    ArmPoses,
    Noise,
    Term,
    TrackedPoint,
)
from suta_calib.trust.observability import Indices, Observability, observe
from suta_calib.trust.rich_data import RichData, Sort
from suta_calib.trust.tip_motion import tip_motion

THESIS = (
    Selection(("joint_*.offset",), bound_rad=np.radians(15)),
    Selection(
        ("joint_2.z", "joint_3.z", "joint_4.z", "joint_5.z", "joint_6.z", "tip.y", "tip.z"),
        bound_m=0.03,
    ),
)


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return arm_named("suta")


@pytest.fixture(scope="module")
def parallel(arm: ArmModel) -> Scene:
    """Touches of upright pillars on level placements: the tool never tilts."""
    return artefact_scene("pairwise_distance", arm, {}, artefact(6), placements(3))


@pytest.fixture(scope="module")
def pivot(arm: ArmModel) -> Term:
    """Touches of one point from directions within a wide cone."""
    return fixed_point_scene(arm, {}, 30, ((0.45, 0.05, 0.1),)).exact()


def tracked(arm: ArmModel, n: int = 30, sigma: float | None = None) -> TrackedPoint:
    """Simulated positions from an instrument in the base."""
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (n, len(arm.joints)))
    samples = Samples.from_arrays(arm.joints, q, position=arm.forward(q)[1])
    return TrackedPoint(ArmPoses(arm, samples), Noise(sigma))


def seen(arm: ArmModel, terms: list[Term], *rows: Selection | str) -> Observability:
    return observe(Problem(terms, arm.select(*rows)))


def why(found: Observability) -> dict[str, str]:
    return {e.fixed: e.sentence for e in found.explanations}


def test_parallel_pillars_hide_three_of_thirteen(arm: ArmModel, parallel: Scene) -> None:
    found = seen(arm, [parallel.exact()], *THESIS)
    assert (found.rank, found.asked) == (10, 13)
    assert set(found.unidentified) == {"joint_1.offset", "joint_2.z", "tip.y"}
    assert found.assessment.level == "care"
    assert found.assessment.usable
    reasons = why(found)
    assert "turns the whole arm about the base's z axis" in reasons["joint_1.offset"]
    assert "shifts the whole arm along the base's z axis" in reasons["joint_2.z"]
    assert "tool's length along the tip's z axis" in reasons["tip.y"]
    remedies = {e.fixed: e.remedy for e in found.explanations}
    assert "fixed_point" in remedies["tip.y"]
    assert "tilt the tool" in remedies["tip.y"]
    assert set(found.redundant) == {"joint_1.offset", "joint_2.z"}
    # An instrument that stands anywhere sees no more of where the arm stands.
    assert remedies["joint_2.z"].startswith("nothing to do")
    assert "tracked_point" not in remedies["joint_2.z"]


def test_the_remedy_works(arm: ArmModel, parallel: Scene, pivot: Term) -> None:
    found = seen(arm, [parallel.exact(), pivot], *THESIS)
    assert set(found.unidentified) == {"joint_1.offset", "joint_2.z"}
    assert found.prospects["tip.y"].std is not None


def whole_geometry(arm: ArmModel) -> tuple[Selection, Selection]:
    """Everything that `init` frees."""
    geometry = Selection(("geometric",), bound_m=0.03, bound_rad=0.26)
    return geometry, Selection(("*.offset",), bound_rad=0.26)


SORTS = [
    ("pairwise_distance", False, 21),
    ("landmark", False, 21),
    ("landmark", True, 24),
    ("fixed_point", False, 20),
    ("plane", False, 20),
    ("tracked_point", False, 21),
    ("tracked_point", True, 24),
    ("hand_eye", True, 18),
]


@pytest.mark.parametrize(("kind", "oriented", "rank"), SORTS)
def test_rich_data_tell_all_but_what_geometry_hides(
    arm: ArmModel, kind: str, oriented: bool, rank: int
) -> None:
    """Four numbers for each of six turning joints and six for the tip, less six for the base: 24
    (Everett, Hsu 1988). Without orientations three less; without any length the scale less; and a
    camera whose place on the tip is unknown says nothing of the tip."""
    problem = Problem([tracked(arm)], arm.select(*whole_geometry(arm)))
    told = RichData(problem, problem.start()).tells(KINDS[kind], oriented)
    values = np.linalg.eigvalsh(told)
    assert np.sum(values > 1e-6 * values[-1]) == rank
    assert values[-rank - 1] < 1e-9 * values[-1]


@pytest.mark.parametrize("name", ["suta", "ur5", "panda"])
def test_only_conventions_stay_open_with_rich_data(name: str) -> None:
    arm = arm_named(name)
    q = random_readings(arm, np.random.default_rng(5), 40)
    samples = Samples.from_arrays(arm.joints, q, position=arm.forward(q)[1])
    found = seen(arm, [TrackedPoint(ArmPoses(arm, samples))], *whole_geometry(arm))
    assert found.unidentified
    assert set(found.unidentified) == set(found.redundant)
    assert found.assessment.level == "good"


def test_a_scale_that_nothing_tells_is_no_convention(arm: ArmModel) -> None:
    """Touching fixed points leaves the size of the arm open, and its tip wrong by that."""
    found = seen(arm, [fixed_point_scene(arm, {}, 25).exact()], *whole_geometry(arm))
    (scale,) = [e for e in found.explanations if e.reason != "redundant"]
    assert "tracked_point" in scale.remedy
    assert found.assessment.level == "care"


def test_a_camera_that_sees_orientations_is_not_asked_for_them(arm: ArmModel) -> None:
    """Its unknown pose in the hand makes up for the tip; no advice that would not tell it."""
    found = seen(arm, [hand_eye_scene(arm, {}, 40).exact()], *whole_geometry(arm))
    assert found.assessment.level == "good"
    of_tip = [e for e in found.explanations if e.fixed.startswith("tip.")]
    assert of_tip
    for each in of_tip:
        assert "no observation measures" not in each.sentence
        assert "fixed_point" not in each.remedy or not each.fixed.startswith("tip.r")


def test_what_the_tip_depends_on_is_no_convention(arm: ArmModel) -> None:
    """The tip moves as is said, in postures that no sample visited; not so where the arm stands."""
    found = seen(arm, [hand_eye_scene(arm, {}, 40).exact()], *THESIS)
    stakes = {e.fixed: e.moves for e in found.explanations if e.as_drawn}
    assert set(stakes) < set(found.redundant)
    assert {n for n, p in found.prospects.items() if p.as_drawn} == set(stakes)
    assert {"tip.y", "tip.z"} <= set(stakes)
    assert not {"joint_1.offset", "joint_2.z"} & set(stakes)
    q = random_readings(arm, np.random.default_rng(5), 400)
    here, there = (arm.forward(q, {"tip.y": value})[1] for value in (0.0, 1e-4))
    rotation, position = register_points(there, here)
    moved = rms_length(there @ rotation.T + position - here) / 1e-4
    assert stakes["tip.y"] == pytest.approx(moved, rel=0.02)
    text = " ".join(part.text for part in explained(found.explanations, "everywhere"))
    convention, drawn = text.split("No data of these kinds can determine ")
    assert "joint_2.z" in convention
    assert all(name in drawn and name not in convention for name in stakes)


def test_advice_that_is_followed_tells_the_parameter(arm: ArmModel, parallel: Scene) -> None:
    rows = whole_geometry(arm)
    term = parallel.exact()
    before = seen(arm, [term], *rows)
    rich = RichData(before.problem, before.problem.start())
    for each in before.explanations:
        if each.reason == "redundant":
            continue
        for kind in shipped(KINDS).values():
            if f"({kind.kind})" not in each.remedy:
                continue
            added, _ = rich.observations(Sort(kind, oriented=False), "added")
            after = seen(arm, [term, added], *rows)
            assert len(after.unidentified) < len(before.unidentified)


def test_pose_of_every_placement_absorbs_the_base(arm: ArmModel, parallel: Scene) -> None:
    found = seen(arm, [replace(parallel, kind="landmark").exact()], *THESIS)
    assert "cannot show where the arm stands" in why(found)["joint_1.offset"]


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (("joint_1.x",), "shifts the whole arm along the base's x axis"),
        (("joint_1.offset",), "turns the whole arm about the base's z axis"),
        (("tip.rx",), "turns the tip without moving it"),
        (("joint_6.offset", "tip.x"), "turns the tip without moving it"),
        (("joint_3.y", "joint_4.z"), "slide a joint's frame along its axis"),
        (("joint_2.rz", "joint_2.offset"), "turn a joint's frame about its axis"),
    ],
)
def test_an_instrument_leaves_open_what_it_must(
    arm: ArmModel, names: tuple[str, ...], says: str
) -> None:
    found = seen(arm, [tracked(arm)], *names)
    assert found.rank == len(names) - 1
    assert len(found.unidentified) == 1
    explanation = found.explanations[0]
    assert says in explanation.sentence
    assert explanation.remedy
    for name in names:
        assert name in explanation.sentence


def test_what_the_poses_do_not_excite_is_said_with_numbers(arm: ArmModel) -> None:
    """Noise of 5 cm on a few poses: nothing is exactly open, and nothing is worth reporting."""
    rows = Selection(("joint_4.z",), bound_m=0.001)
    found = seen(arm, [tracked(arm, 6, sigma=0.05)], rows)
    assert "joint_4.z" in found.unidentified
    sentence = why(found)["joint_4.z"]
    assert "hardly changes any measured value" in sentence
    assert "±1 mm is known beforehand" in sentence
    predicted = float(sentence.split("predicted ±")[1].split(" mm")[0])
    assert 1.0 < predicted < 500.0


def test_states_of_prior_and_fixed(arm: ArmModel) -> None:
    rows = (
        Selection(("joint_4.z",), prior_m=1e-6),
        Selection(("joint_2.offset",), prior_rad=0.5),
        Selection(("joint_3.offset",), fixed=True),
    )
    found = seen(arm, [tracked(arm)], *rows)
    states = {n: found.prospects[n].state for n in ("joint_4.z", "joint_2.offset")}
    assert states == {"joint_4.z": "prior", "joint_2.offset": "identified"}
    assert found.prospects["joint_3.offset"].state == "fixed"
    assert found.prospects["joint_3.offset"].std is None
    assert (found.rank, found.asked, len(found.singular_values)) == (2, 2, 1)


def test_predicted_deviation_of_a_simple_case(arm: ArmModel) -> None:
    """Twice the noise is twice the deviation; the number itself from a dense least squares.

    What is held, and the instrument's scale, add a little of their own.
    """
    found = seen(arm, [tracked(arm, 20, sigma=1e-3)], "joint_4.z", "joint_2.offset")
    again = seen(arm, [tracked(arm, 20, sigma=2e-3)], "joint_4.z", "joint_2.offset")
    problem = found.problem

    def by_noise(sigma: float) -> FloatArray:
        information = predicted_information(problem, problem.start(), [sigma])
        estimated = np.arange(len(problem.names))
        return np.asarray(np.sqrt(np.diag(predicted_covariance(problem, information, estimated))))

    x, h = problem.start(), 1e-6
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = h
        ends = [problem.linearise(x + s * step, [1e-3])[0].residual.copy() for s in (1, -1)]
        columns.append((ends[0] - ends[1]).reshape(-1) / (2 * h))
    J = np.array(columns).T / 1e-3
    expected = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    for k, name in enumerate(problem.names[:2]):
        assert by_noise(1e-3)[k] == pytest.approx(expected[k], rel=1e-5)
        assert by_noise(2e-3)[k] == pytest.approx(2 * expected[k], rel=1e-5)
        for prospects, times in ((found.prospects, 1.0), (again.prospects, 2.0)):
            std = prospects[name].std
            assert std is not None
            assert 1.0 <= std / (times * expected[k]) < 1.1
    # The own unknowns follow, so only the arm's columns orthogonal to theirs count.
    unit = np.array([p.plausible for p in found.prospects.values()])
    scaled = J * unit
    Q, _ = np.linalg.qr(scaled[:, 2:])
    left = scaled[:, :2] - Q @ (Q.T @ scaled[:, :2])
    assert found.singular_values == pytest.approx(np.linalg.svd(left)[1], rel=1e-5)


def test_indices_of_known_singular_values() -> None:
    found = Indices.of(np.array([4.0, 1.0]), samples=4)
    assert found.as_dict() == pytest.approx(
        {"O1": 1.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 0.8}
    )
    nothing = dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    assert Indices.of(np.zeros(0), 4).as_dict() == nothing
    assert Indices.of(np.array([1.0, 0.0]), 4).as_dict() == nothing


@pytest.mark.parametrize("name", ["joint_1.offset", "joint_4.z", "joint_5.rx", "tip.y", "tip.rz"])
def test_tip_motion_equals_central_differences(arm: ArmModel, name: str) -> None:
    term = tracked(arm, 5)
    problem = Problem([term], arm.select(name))
    motion = tip_motion(problem, problem.start(), {name: 1.0})
    h = 1e-6
    ends = [
        arm.forward(term.poses.samples.q, {name: arm.parameters[name].nominal + s * h})
        for s in (1, -1)
    ]
    turn = Rotation.from_matrix(ends[0][0] @ np.swapaxes(ends[1][0], 1, 2)).as_rotvec()
    assert motion.linear == pytest.approx((ends[0][1] - ends[1][1]) / (2 * h), abs=1e-8)
    assert motion.angular == pytest.approx(turn / (2 * h), abs=1e-8)


@pytest.mark.parametrize(
    ("name", "base", "tool", "in_place"),
    [
        ("joint_1.offset", True, False, False),
        ("joint_1.y", True, False, False),
        ("tip.x", False, True, False),
        ("tip.ry", False, True, True),
        ("joint_4.offset", False, False, False),
    ],
)
def test_rigid_motions_are_told_apart(
    arm: ArmModel, name: str, base: bool, tool: bool, in_place: bool
) -> None:
    problem = Problem([tracked(arm)], arm.select(name))
    motion = tip_motion(problem, problem.start(), {name: 1.0})
    assert (motion.base_twist()[2] < 1e-9) is base
    assert (motion.tool_twist()[2] < 1e-9) is tool
    assert motion.turns_in_place is in_place


@pytest.fixture(scope="module")
def panda(shared: Path) -> Callable[[], Observability]:
    from suta_calib.job.calibration import CalibrationJob

    path = shared / "real" / "mukca_panda_2_clean" / "calibration.yaml"
    return lambda: observe(CalibrationJob.load(path).problem())


def test_collinear_landmarks_leave_a_turn_of_the_placement(
    panda: Callable[[], Observability],
) -> None:
    found = panda()
    assert len(found.explanations) == 1
    assert "about a line through the landmarks" in found.explanations[0].sentence
    assert all(p.state != "unidentified" for p in list(found.prospects.values())[: found.asked])
