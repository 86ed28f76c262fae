"""What an instrument sees may be screwed on anywhere: the mount comes first, the geometry after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, perturbed

from suta_calib import ArmModel, Problem, Selection, SolverOptions, solve
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.measurements import Samples
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.mount_start import FreeMount
from suta_calib.terms import ArmPoses, TrackedPoint
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination

NOISE, TURN_NOISE = 2e-4, 5e-4
OFFSETS = Selection(("*.offset",), bound_rad=np.radians(15.0))
GEOMETRY = Selection(("geometric",), bound_m=0.03, bound_rad=np.radians(5.0))
WIDE = Selection(("tip.*",), bound_m=1.0, bound_rad=np.pi)
# A tool behind a flange, both behind a table that turns on one that tilts.
TWO_AXES = """\
<robot name="two_axes"><link name="base"/>
  <joint name="tilt" type="revolute"><origin xyz="0 0 0.8"/><parent link="base"/>
    <child link="yoke"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="0" velocity="1"/></joint><link name="yoke"/>
  <joint name="turn" type="continuous"><origin xyz="0 0 0.4"/><parent link="yoke"/>
    <child link="table"/><axis xyz="0 0 1"/></joint><link name="table"/>
  <joint name="flange" type="fixed"><origin xyz="0.1 0 0.05" rpy="0.3 0 0.2"/>
    <parent link="table"/><child link="plate"/></joint><link name="plate"/>
  <joint name="tip" type="fixed"><origin xyz="0 0.2 0.1" rpy="0 -0.4 0"/><parent link="plate"/>
    <child link="tip"/></joint><link name="tip"/>
</robot>
"""


@pytest.fixture(scope="module")
def two_axes(tmp_path_factory: pytest.TempPathFactory) -> ArmModel:
    path: Path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(TWO_AXES, encoding="utf-8")
    return ArmModel.from_urdf(path, "tip")


def seen(
    arm: ArmModel,
    unknown: ParameterSet,
    seed: int,
    *,
    oriented: bool,
    mount: tuple[FloatArray, FloatArray] | None = None,
    noise: float = 1.0,
    rows: int = 60,
) -> TrackedPoint:
    """Simulated: a body screwed on at any turn, up to 0.3 m from the tip of an arm that errs."""
    random = np.random.default_rng(seed)
    q = random.uniform(-0.9, 0.9, (rows, len(arm.joints))) * [*[1.0] * (len(arm.joints) - 1), 3.0]
    rotation, position = arm.forward(q, perturbed(unknown, seed, 1e-3, 3e-3) if noise else {})
    turn, place = mount or (random_rotations(random, 1)[0], random.uniform(-0.3, 0.3, 3))
    base, at = random_rotations(random, 1)[0], random.uniform(-2.0, 2.0, 3)
    position = (position + rotation @ place) @ base.T + at
    position = position + noise * NOISE * random.standard_normal(position.shape)
    shaken = rotation_from_vector(noise * TURN_NOISE * random.standard_normal((rows, 3)))
    samples = Samples.from_arrays(
        arm.joints,
        q,
        position=position,
        rotation=base @ rotation @ turn @ shaken if oriented else None,
    )
    return TrackedPoint(ArmPoses(arm, samples))


@pytest.mark.parametrize("oriented", [True, False])
def test_the_mount_is_found_in_closed_form(two_axes: ArmModel, oriented: bool) -> None:
    mount = random_rotations(np.random.default_rng(5), 1)[0], np.array([0.2, -0.6, 0.3])
    term = seen(two_axes, two_axes.select("*.offset"), 1, oriented=oriented, mount=mount, noise=0.0)
    found = term.mount(*term.poses.at({}))
    assert found is not None
    assert found.position == pytest.approx(mount[1], abs=1e-9)
    if oriented:
        assert found.rotation == pytest.approx(mount[0], abs=1e-9)
    else:
        assert found.rotation is None


@pytest.mark.parametrize(
    "wide",
    [
        ("tip.*",),
        ("turn.offset", "tip.*"),
        ("turn.offset", "flange.x", "flange.y", "flange.z", "flange.rx", "flange.ry", "tip.rz"),
    ],
)
def test_whatever_is_free_takes_the_mount_up(two_axes: ArmModel, wide: tuple[str, ...]) -> None:
    unknown = two_axes.select(Selection(wide, bound_m=1.5, bound_rad=np.pi))
    term = seen(two_axes, unknown, 3, oriented=True, noise=0.0)
    problem = Problem([term], unknown)
    (mount,) = FreeMount.of(problem)
    assert mount is not None
    (values,) = mount.starts({})
    x = problem.start(values)
    position, rotation = problem.linearise(x, problem.assumed_sigmas())
    assert np.abs(position.residual).max() < 1e-4
    assert np.abs(rotation.residual).max() < 1e-4


def test_a_mount_within_reach_is_left_where_it_is_drawn(two_axes: ArmModel) -> None:
    unknown = two_axes.select(OFFSETS, GEOMETRY)
    term = seen(two_axes, unknown, 3, oriented=True)
    assert FreeMount.of(Problem([term], unknown)) == ()
    held = {k for k, name in enumerate(unknown.names) if name.startswith("tip.")}
    wide = two_axes.select(OFFSETS, GEOMETRY, WIDE)
    assert FreeMount.of(Problem([term], wide))
    assert FreeMount.of(Problem([term], wide), held) == ()


@pytest.mark.parametrize("oriented", [True, False])
@pytest.mark.parametrize("name", ["two axes", "suta"])
def test_a_mount_of_any_turn_is_solved_as_asked(
    name: str, oriented: bool, two_axes: ArmModel
) -> None:
    arm = two_axes if name == "two axes" else arm_named(name)
    unknown = arm.select(OFFSETS, GEOMETRY, WIDE)
    term = seen(arm, arm.select(OFFSETS, GEOMETRY), 2, oriented=oriented)
    solution = solve(Problem([term], unknown), SolverOptions(starts=3))
    assert solution.converged
    assert solution.noise[0] == pytest.approx(NOISE, rel=0.2)
    assert len({round(each.cost, 3) for each in solution.attempts}) == 1


def test_an_encoder_that_is_mounted_at_any_turn(two_axes: ArmModel) -> None:
    """The last joint's zero alone is unknown: a turn about its axis, which is no arm's geometry."""
    unknown = two_axes.select(Selection(("turn.offset",), bound_rad=np.pi))
    (last,) = [s for s in two_axes.segments if s.owner == "turn"]
    tail, at = two_axes.forward(np.zeros((1, 2)))
    turn = rotation_from_vector(2.5 * last.axis)
    # The tool turned about the table's axis, in the tip's frame.
    mount = tail[0].T @ turn @ tail[0], tail[0].T @ (turn @ at[0] - at[0])
    term = seen(two_axes, unknown, 4, oriented=True, mount=mount, noise=0.0)
    solution = solve(Problem([term], unknown))
    assert solution.values["turn.offset"] == pytest.approx(2.5, abs=1e-6)


@pytest.mark.parametrize(("oriented", "what"), [(True, "a body"), (False, "a reflector")])
@pytest.mark.parametrize("name", ["two axes", "suta"])
def test_a_refusal_names_the_column(
    name: str, oriented: bool, what: str, two_axes: ArmModel
) -> None:
    """Nobody moved the instrument."""
    arm = two_axes if name == "two axes" else arm_named(name)
    unknown = arm.select(OFFSETS, GEOMETRY)
    term = seen(arm, unknown, 2, oriented=oriented)
    solution = solve(Problem([term], unknown))
    found = assess_calibration(CalibrationExamination.of(solution))
    assert found.level == "bad"
    assert f"if the instrument measures {what} " in found.notes[0]
    assert "give its name in a column target" in found.notes[0]
    assert not any("was moved" in note for note in found.notes)
    _, marked = term.on_unknown_mount or ("", term)
    assert solve(Problem([marked], unknown)).noise[0] == pytest.approx(NOISE, rel=0.2)
