"""Another unit is known before anything is solved."""

from __future__ import annotations

from dataclasses import replace

import pytest
from simulated import Scene
from terms_cases import SIGMA, noises, scene

from suta_calib.errors import SamplesError
from suta_calib.measurements import Artefact
from suta_calib.terms import ArmPoses, Term

SEEN = ("tracked_point", "tracked_point with orientation", "hand_eye")
TOUCHED = ("pairwise_distance", "landmark", "landmark with seats")


def scaled(name: str, scale: float) -> Term:
    s = scene(name)
    samples = s.samples(SIGMA)[0]
    if samples.position is not None:
        samples = replace(samples, position=scale * samples.position)
    return sized(s, scale).term(samples, *noises(SIGMA, False))


def sized(s: Scene, scale: float) -> Scene:
    if s.artefact is None:
        return s
    marks = s.artefact.landmarks.items()
    larger = {name: replace(mark, position=scale * mark.position) for name, mark in marks}
    return replace(s, artefact=Artefact(s.artefact.name, larger))


@pytest.mark.parametrize("name", [*SEEN, *TOUCHED])
@pytest.mark.parametrize("scale", [1e3, 1e-3])
def test_millimetres_for_metres_are_refused_and_the_place_is_named(name: str, scale: float) -> None:
    place = "columns x, y, z are in m, and x_mm" if name in SEEN else "position_mm of the artefact"
    with pytest.raises(SamplesError, match=f"about their middle.*{place}") as caught:
        scaled(name, scale).check_enough()
    assert scene(name).kind in str(caught.value)


@pytest.mark.parametrize("name", [*SEEN, *TOUCHED])
@pytest.mark.parametrize("scale", [0.8, 1.0, 1.25])
def test_a_bad_arm_or_instrument_is_no_other_unit(name: str, scale: float) -> None:
    scaled(name, scale).check_enough()


@pytest.mark.parametrize("name", ["tracked_point", "pairwise_distance", "landmark"])
def test_a_length_of_the_arm_in_another_unit_is_named_beside(name: str) -> None:
    """Its one upper arm 100 times as long; and no length where all that was seen is small."""
    s = scene(name)
    length = max(
        (p for p in s.arm.parameters.values() if p.unit == "m"), key=lambda p: abs(p.nominal)
    )
    term = scaled(name, 1.0)
    wrong = s.arm.at({length.name: 100.0 * length.nominal})
    with pytest.raises(SamplesError) as caught:
        term.over_poses(ArmPoses(wrong, term.poses.samples)).check_enough()
    named = f"They would agree if {length.name} is {1e3 * length.nominal:.6g} mm instead of"
    assert named in str(caught.value)
    with pytest.raises(SamplesError) as caught:
        scaled(name, 1e-3).check_enough()
    assert "They would agree" not in str(caught.value)


def test_a_camera_that_circles_its_target_sees_it_stand_still() -> None:
    s = scene("hand_eye")
    samples = s.samples()[0]
    assert samples.position is not None
    still = 0.0 * samples.position + [0.0, 0.0, 0.5]
    s.term(replace(samples, position=still), *noises(SIGMA, False)).check_enough()


def test_a_single_landmark_at_each_placement_has_no_size() -> None:
    s = scene("landmark with seats")
    samples = s.samples(SIGMA)[0]
    s.term(samples.take(samples.labels["landmark"] == "L1")).check_enough()
