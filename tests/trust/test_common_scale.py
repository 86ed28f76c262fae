"""All lengths that came out too long or too short by one factor: whose scale is off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from judging import assessed, notes_on
from offset_arm import NOISE, ONCE, truth_of, unknowns
from simulated import (
    Scene,
    arm_named,
    artefact,
    artefact_scene,
    perturbed,
    placements,
    tracked_scene,
)

from suta_calib import Problem, Selection, Term, solve
from suta_calib.measurements import Artefact, LengthScale
from suta_calib.trust import LinearFit
from suta_calib.trust.common_scale import _one_alone, grown_together, relied_on
from suta_calib.trust.scale_effects import scale_effects


def seen_longer(scene: Scene, factor: float) -> Term:
    """Positions that an instrument makes longer by a factor."""
    samples = scene.samples(NOISE)[0]
    assert samples.position is not None
    return scene.term(replace(samples, position=factor * samples.position))


def certified_longer(scene: Scene, factor: float) -> Term:
    """Touches of an artefact whose certificate is longer by a factor."""
    assert scene.artefact is not None
    marks = scene.artefact.landmarks.items()
    scaled = {n: replace(m, position=factor * m.position) for n, m in marks}
    return replace(scene, artefact=Artefact("scaled", scaled)).term(scene.samples(NOISE)[0])


GROWING = (
    Selection(("geometric",), bound_m=0.05, bound_rad=0.26),
    Selection(("*.offset",), bound_rad=0.26),
)


@pytest.mark.parametrize("factor", [0.985, 1.0, 1.015])
@pytest.mark.parametrize("kind", ["tracked_point", "pairwise_distance"])
def test_a_scale_that_joints_would_absorb_is_named(kind: str, factor: float) -> None:
    """Priors of a millimetre on every length cannot all be stretched alike by chance."""
    arm = arm_named("suta")
    parameters = unknowns(arm, priors=True)
    truth = {p.name: p.nominal for p in parameters.values()}
    truth |= truth_of(arm) | {"joint_4.z": truth["joint_4.z"] + 1e-3}
    if kind == "tracked_point":
        term = seen_longer(tracked_scene(arm, truth, 60), factor)
    else:
        scene = artefact_scene(kind, arm, truth, artefact(6), placements(4))
        term = certified_longer(scene, factor)
    found = assessed(solve(Problem([term], parameters), ONCE))
    said = " ".join(found.notes)
    if factor == 1.0:
        assert "all lengths" not in said
        return
    what = "instrument" if kind == "tracked_point" else "artefact"
    assert f"all lengths of the {what} are 1." in said
    assert f"too {'long' if factor > 1 else 'short'}" in said
    assert not found.usable


@pytest.mark.parametrize("name", ["joint_4.z", "joint_6.z"])
def test_one_length_that_is_off_alone_is_no_scale(name: str) -> None:
    """A link 15 mm off was first called an instrument 1.9 % too short."""
    arm = arm_named("suta")
    parameters = unknowns(arm, priors=True)
    truth = {p.name: p.nominal for p in parameters.values()} | truth_of(arm)
    truth[name] += 0.015
    term = tracked_scene(arm, truth, 60).samples(NOISE)[0]
    said = notes_on(solve(Problem([tracked_scene(arm, truth, 60).term(term)], parameters), ONCE))
    assert "all lengths" not in said


def test_the_length_that_is_off_alone_is_named_with_its_size() -> None:
    """Without its prior: H⁻¹ says what a fit would find (leave one out)."""
    precision, away = np.array([30.0, 1.0]), np.array([0.25, 0.1])
    # At the minimum rows and priors pull alike.
    rows = np.sqrt([10.0, 4.0])
    alone = _one_alone(LinearFit(np.diag(rows), -precision * away / rows, precision, away))
    assert alone is not None
    number, lowered, off = alone
    assert number == 0
    # Data of weight 10 say 1.0, a prior of weight 30 says 0: together 0.25.
    assert off == pytest.approx(1.0)
    assert lowered == pytest.approx(10 * 0.75**2 + 30 * 0.25**2)


def test_lengths_rest_on_an_instruments_scale_unless_something_else_tells_it() -> None:
    """What is off by less than priors notice is in every length: 300 ppm where 20 are said."""
    arm = arm_named("ur5")
    everything = arm.select(Selection(("geometric",), bound_m=0.05, bound_rad=0.26))
    turns = arm.select(Selection(("*.offset",), bound_rad=0.26))
    truth = perturbed(everything, 0, 3e-4, 3e-3)
    seen = tracked_scene(arm, truth, 60)
    larger = seen_longer(seen, 1.0003)
    held_out = np.arange(60) % 3 == 0
    solution = solve(Problem([larger.take(~held_out)], everything), ONCE)
    assert relied_on(solution) == [("instrument", "default")]
    found = assessed(solution, [larger.take(held_out)])
    assert found.level == "good"
    assert "The instrument carries the scale" in found.notes[-1]
    assert "20 ppm" in found.notes[-1]
    off = abs(solution.values["elbow_joint.z"] - truth["elbow_joint.z"])
    upper_arm = solution.arm_estimates["elbow_joint.z"]
    assert upper_arm.std is not None
    assert off > 3 * upper_arm.std
    # As good an instrument as it is, said to be so, and ± holds what it does.
    stated = replace(larger.take(~held_out), scale=LengthScale(300e-6))
    upper_arm = solve(Problem([stated], everything), ONCE).arm_estimates["elbow_joint.z"]
    assert upper_arm.std is not None
    assert off < 2 * upper_arm.std
    # Where the drawing's lengths are believed, they tell the scale.
    assert relied_on(solve(Problem([larger], turns), ONCE)) == []


def test_a_scale_goes_into_what_is_free_beside_long_lengths_that_are_held() -> None:
    """Where it moves the tip by a quarter of what the arm would grow by, or more, it is named."""
    arm = arm_named("suta")
    lengths = Selection(("joint_?.x", "tip.z"), bound_m=0.05)
    unknown = arm.select(Selection(("*.offset",), bound_rad=0.26), lengths)
    certified = replace(artefact(6), scale=LengthScale(2e-5, "certified"))
    scene = artefact_scene("landmark", arm, truth_of(arm), certified, placements(5))
    solution = solve(Problem([scene.term(scene.samples(NOISE)[0])], unknown), ONCE)
    assert not relied_on(solution)
    (effect,) = scale_effects(solution)
    found = assessed(solution)
    assert effect.bends
    assert effect.carries
    assert sum("follow the scale of the artefact" in note for note in found.notes) == 1


def test_an_arm_whose_lengths_all_grow_alike_is_said() -> None:
    """Without priors the size of the arm is free: only its evenness tells."""
    arm = arm_named("ur5")
    unknown = arm.select(*GROWING)
    scene = tracked_scene(arm, perturbed(unknown, 0, 3e-4, 3e-3), 60)
    for factor in (1.0, 1.02):
        said = notes_on(solve(Problem([seen_longer(scene, factor)], unknown), ONCE))
        assert ("All lengths of the arm came out" in said) == (factor != 1.0)


@pytest.mark.parametrize("scatter", [2e-4, 2e-3])
def test_lengths_that_are_off_by_nature_have_not_grown_together(scatter: float) -> None:
    """The chance of a false alarm is as stated; two per cent are seen in spite of the scatter."""
    rng = np.random.default_rng(4)
    length, std = np.array([0.571, 0.371, 0.0, 0.0, 0.0]), np.array([6, 4, 3, 16, 0.3]) * 1e-4

    def significances(factor: float) -> list[float]:
        changes = factor * length + np.hypot(scatter, std) * rng.standard_normal((300, 5))
        return [grown_together(length, c, np.diag(std**2)).significance for c in changes]

    # Two standard deviations on either side.
    assert np.mean(np.array(significances(0.0)) > 2.0) < 0.0455 + 3 * math.sqrt(0.0455 / 300)
    assert np.mean(np.array(significances(0.02)) > 2.0) > 0.9


@pytest.mark.parametrize("factor", [1.0, 1.02])
def test_a_scale_is_seen_beside_what_the_model_lacks(factor: float) -> None:
    arm = arm_named("suta")
    lengths = [f"joint_{k}.z" for k in range(2, 7)]
    unknown = arm.select(
        Selection(("joint_*.offset",), bound_rad=0.26), Selection((*lengths, "tip.z"), bound_m=0.03)
    )
    crooked = perturbed(arm.select(Selection(("joint_?.[xy]",), bound_m=0.01)), 3, 1e-3, 0.0)
    truth = truth_of(arm) | crooked | {name: 5e-4 * k for k, name in enumerate(lengths)}
    truth |= {
        name: value + arm.offered[name].nominal for name, value in truth.items() if name in lengths
    }
    scene = artefact_scene("pairwise_distance", arm, truth, artefact(6), placements(5))
    solution = solve(Problem([certified_longer(scene, factor)], unknown), ONCE)
    assert solution.noise[0] > 3e-4
    said = notes_on(solution)
    assert ("All lengths of the arm came out" in said) == (factor != 1.0)


@pytest.mark.parametrize(("grade", "factor"), [("", 1.03), ("machined", 1.004), ("", 1.0)])
def test_lengths_that_no_drawing_of_the_grade_allows_are_named(grade: str, factor: float) -> None:
    """Two lengths are freed: too few for their evenness alone to say anything."""
    arm = arm_named("suta").of_grade(grade)
    lengths = Selection(("joint_4.z", "joint_6.z"), bound_m=0.05)
    unknown = arm.select(Selection(("joint_*.offset",), bound_rad=0.26), lengths)
    scene = artefact_scene("pairwise_distance", arm, truth_of(arm), artefact(6), placements(5))
    term = certified_longer(scene, factor)
    said = notes_on(solve(Problem([term], unknown), ONCE))
    assert ("All lengths of the arm came out" in said) == (factor != 1.0)
    assert "The artefact carries the scale" in said


@pytest.mark.parametrize(("priors_off", "level"), [(0.0, "care"), (5.0, "care"), (8.0, "bad")])
def test_an_arm_that_priors_hold_too_short_is_no_wrong_instrument(
    priors_off: float, level: str
) -> None:
    """Both explain the same: up to six prior standard deviations, none of them is refused."""
    arm = arm_named("suta")
    parameters = unknowns(arm, priors=True)
    longer = 1.0 + 1.81e-3 * priors_off
    truth = {p.name: p.nominal for p in parameters.values()} | truth_of(arm)
    truth |= {n: v * longer for n, v in truth.items() if n.rpartition(".")[2] in "xyz"}
    term = tracked_scene(arm, truth, 60).term(tracked_scene(arm, truth, 60).samples(NOISE)[0])
    found = assessed(solve(Problem([term], parameters), ONCE))
    said = " ".join(found.notes)
    # There are no validation data.
    assert found.level == level
    assert ("or if all lengths of the arm are that much longer" in said) == (priors_off > 0.0)


@pytest.mark.parametrize(("factor", "named"), [(1.02, True), (1.01, False)])
def test_an_arm_may_grow_as_far_as_its_instrument_may_be_off(factor: float, named: bool) -> None:
    """Half a per cent is stated of what was printed: two per cent are four of that."""
    arm = arm_named("ur5")
    unknown = arm.select(*GROWING)
    scene = tracked_scene(arm, perturbed(unknown, 0, 3e-4, 3e-3), 60)
    term = replace(seen_longer(scene, factor), scale=LengthScale.of_grade("printed"))
    said = notes_on(solve(Problem([term], unknown), ONCE))
    assert ("All lengths of the arm came out" in said) == named
