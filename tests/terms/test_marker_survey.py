"""Markers of unknown places: where pictures have them, and what is said of the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from marker_scenes import CAMERA, DICTIONARY, MarkerScene, marker_scene, sought, wall

from suta_calib.errors import SamplesError
from suta_calib.measurements.board import Marker, Markers
from suta_calib.terms.hand_eye_start import EyeSetup, as_eye_in_hand
from suta_calib.terms.marker_survey import surveyed
from suta_calib.terms.surveyed_markers import SurveyedMarkers


def survey(
    scene: MarkerScene, file: Mapping[int, Marker], setup: EyeSetup = "eye-in-hand"
) -> SurveyedMarkers:
    """The board as the pictures of a scene have it."""
    hand = zip(*as_eye_in_hand(scene.hand.pose, setup), strict=True)
    by_picture = dict(zip(scene.hand.image.tolist(), hand, strict=True))
    return surveyed(Markers(DICTIONARY, file), scene.corners, CAMERA, by_picture)


def assert_near(found: SurveyedMarkers, true: Mapping[int, Marker], within: float) -> None:
    for number, marker in found.markers.items():
        assert marker.position == pytest.approx(true[number].position, abs=within)
        assert marker.size == pytest.approx(true[number].size, rel=0.01)
        assert marker.rotation == pytest.approx(true[number].rotation, abs=0.02)


@pytest.fixture(scope="module")
def scene() -> MarkerScene:
    return marker_scene(16)


@pytest.mark.parametrize("sizes", [None, (3,), (7,), ()], ids=["all", "first", "other", "none"])
def test_places_and_sizes_are_found(scene: MarkerScene, sizes: tuple[int, ...] | None) -> None:
    found = survey(scene, sought(scene.true, sizes))
    assert_near(found, scene.true, 2e-3)
    assert (found.anchor, found.notes) == (3, ())
    assert set(found.stated) == (set(scene.true) if sizes is None else set(sizes))


def test_a_camera_beside_the_arm_gives_the_scale_too() -> None:
    scene = marker_scene(16, setup="eye-to-hand")
    assert_near(survey(scene, sought(scene.true, ()), "eye-to-hand"), scene.true, 2e-3)


def test_a_marker_whose_place_is_known_is_the_frame(scene: MarkerScene) -> None:
    found = survey(scene, sought(scene.true, ()) | {3: scene.true[3]})
    assert found.anchor is None
    assert found.carries_scale
    assert_near(found, scene.true, 2e-3)


def test_markers_in_no_common_picture_are_joined_by_the_hand(scene: MarkerScene) -> None:
    corners = scene.corners
    one_side = np.isin(corners.point // 4, (3, 4, 6))
    even = np.isin(corners.image, [f"{k:03d}.png" for k in range(0, 16, 2)])
    apart = replace(scene, corners=corners.take(one_side == even))
    found = survey(apart, sought(scene.true, ()))
    assert set(found.markers) == set(scene.true)
    assert found.notes == ()
    assert_near(found, scene.true, 5e-3)


def test_a_wrong_size_is_named_and_estimated(scene: MarkerScene) -> None:
    file = sought(scene.true)
    file[5] = Marker(size=1.1 * file[5].size)
    found = survey(scene, file)
    (note,) = found.notes
    assert "Marker 5 is 0.909 times as large as its size_mm" in note
    assert "the other markers" in note
    assert 5 not in found.stated
    assert_near(found, scene.true, 2e-3)


def test_sizes_that_the_hand_denies_are_named(scene: MarkerScene) -> None:
    file = {n: Marker(size=1.3 * m.size) for n, m in scene.true.items()}
    found = survey(scene, file)
    assert any(
        "By the motions of the hand all markers are about 0.769 times" in n for n in found.notes
    )
    assert_near(found, scene.true, 2e-3)


@pytest.mark.parametrize("moves", [3, 6])
def test_a_marker_that_moved_is_named_and_left_out(moves: int) -> None:
    true = wall()
    place = true[moves].position + np.array([4e-3, 2e-3, 0.0])
    later = true | {moves: replace(true[moves], position=place)}
    found = survey(marker_scene(16, true=true, later=later), sought(true))
    (note,) = found.notes
    assert note.startswith(f"Marker {moves} moved between 007.png and 008.png, by 4.")
    assert moves not in found.markers


def test_markers_that_pictures_leave_open_are_said(scene: MarkerScene) -> None:
    corners = scene.corners
    once = corners.take((corners.point // 4 != 6) | (corners.image == corners.images[0]))
    found = survey(replace(scene, corners=once), sought(scene.true) | {99: Marker()})
    assert set(found.markers) == set(scene.true) - {6}
    never, single = found.notes
    assert "Marker 99 is in no picture" in never
    assert "Marker 6 is in one picture only" in single


def test_a_hand_that_does_not_move_gives_no_scale() -> None:
    scene = marker_scene(8, still=True)
    with pytest.raises(SamplesError, match="motions of the hand that do not determine the scale"):
        survey(scene, sought(scene.true, ()))


def test_an_anchor_that_no_picture_shows_is_another_one(scene: MarkerScene) -> None:
    corners = scene.corners.take(scene.corners.point // 4 != 3)
    found = survey(replace(scene, corners=corners), sought(scene.true))
    assert found.anchor == 4
    assert "Marker 3 is in no picture" in found.notes[0]


def test_sound_pictures_say_nothing() -> None:
    for seed in range(4):
        true = wall(seed=seed)
        assert survey(marker_scene(14, true=true, seed=seed), sought(true)).notes == ()


def test_a_held_size_is_no_unknown(scene: MarkerScene) -> None:
    found = survey(scene, sought(scene.true, (3, 4)))
    names = [p.name for p in found.parameters("default")]
    held = [p.name for p in found.with_reference().parameters("wall")]
    assert "marker[3].size" in names
    assert "marker[3].x" not in names
    assert "marker[wall/3].size" not in held
    assert "marker[wall/4].rz" in held
    larger = found.with_reference().scaled(2.0)
    assert larger.markers[3].size == pytest.approx(2.0 * scene.true[3].size)
