"""Certification against simulated artefacts of known shape: coordinates, faults, wrong touches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from certified_artefact import (
    NOISE,
    TRUE_POSITIONS,
    certified,
    moved,
    positions,
    raw_points,
    truth,
    yaws,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from suta_calib.arrays import FloatArray
from suta_calib.certification.frame import shape_covariance
from suta_calib.certification.measuring import diagonals_cross, order_around
from suta_calib.certification.points import FEATURES, CertificationOptions, read_raw_points
from suta_calib.certification.procedure import certify
from suta_calib.certification.result import write_certified
from suta_calib.errors import InputError, SamplesError
from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector, skew, wrap
from suta_calib.measurements import Artefact, Landmark, read_artefact


def test_exact_points_give_the_artefact_back(tmp_path: Path) -> None:
    found = certified(tmp_path, noise=0.0)
    # The file has whole nanometres.
    np.testing.assert_allclose(positions(found), TRUE_POSITIONS, atol=5e-9)
    yaw = np.array([mark.yaw for mark in found.landmarks])
    np.testing.assert_allclose(wrap(yaw - yaws(truth())), 0.0, atol=1e-6)
    assert (found.origin, found.heading, found.turned) == ("O", "side plane", 0)
    assert [s.length for s in found.spacers] == pytest.approx([0.04, 0.1], abs=5e-9)
    assert found.assessment.level == "good"
    assert [mark.flats for mark in found.landmarks] == pytest.approx([0.01] * 6, abs=5e-9)


def test_it_does_not_matter_where_the_instrument_stands(tmp_path: Path) -> None:
    first, second = (certified(tmp_path, noise=0.0, seed=seed) for seed in (1, 2))
    np.testing.assert_allclose(positions(first), positions(second), atol=1e-8)
    np.testing.assert_allclose(first.covariance, second.covariance, atol=1e-16, rtol=1e-3)


def test_the_file_can_be_calibrated_with(tmp_path: Path) -> None:
    found = certified(tmp_path)
    write_certified(tmp_path / "artefact.yaml", found)
    read = read_artefact(tmp_path / "artefact.yaml")
    for mark in found.landmarks:
        again = read.landmarks[mark.name]
        np.testing.assert_allclose(again.position, mark.position, atol=1e-12)
        assert again.sigma == pytest.approx(mark.std.max(), abs=1e-12)
        np.testing.assert_allclose(again.rotation, mark.rotation, atol=1e-9)
    text = (tmp_path / "artefact.yaml").read_text(encoding="utf-8")
    assert "points of points.csv" in text.splitlines()[0]
    assert "DAMAGED" not in text


def test_the_noise_is_learnt_from_the_touches(tmp_path: Path) -> None:
    found = certified(tmp_path, noise=3e-6)
    assert found.noise == pytest.approx(3e-6, rel=0.3)
    assert found.freedom == 22 + 2 * 6
    doubted = certified(tmp_path, options=CertificationOptions(sigma=1e-6), noise=3e-6)
    assert doubted.noise == pytest.approx(3e-6, rel=0.5)
    assert "more than the given 1.00 µm" in doubted.assessment.notes[0]
    believed = certified(tmp_path, options=CertificationOptions(sigma=5e-6), noise=3e-6)
    assert believed.noise == 5e-6
    assert believed.coverage_factor == pytest.approx(1.96, abs=1e-3)


def test_a_rough_ground_is_no_worse_an_instrument(tmp_path: Path) -> None:
    random = np.random.default_rng(3)

    def rough(feature: str, name: str, index: int, point: FloatArray) -> FloatArray:
        return point + np.array([0, 0, 2e-5 * random.standard_normal() * (feature == "ground")])

    found, smooth = certified(tmp_path, rough), certified(tmp_path)
    assert found.noise < 2 * NOISE < found.ground.rms
    assert found.assessment.level == "care"
    assert not found.damaged
    assert found.landmarks[0].std[2] > 3 * smooth.landmarks[0].std[2]


DRAWN = CertificationOptions(drawing=truth())
# What is spoilt → (which point, by how much (m)), the landmark, the fault's words.
BENT = {
    "leaning top": ("slope", lambda f, _k, p: [0, 0, 0.02 * (p[0] - 0.036)] if f == "top" else 0),
    "uneven top": (
        "uneven",
        lambda f, k, _p: [0, 0, {1: 4e-5, 2: -4e-5}.get(k, 0)] if f == "top" else 0,
    ),
    "hole astray": ("midpoints", lambda f, k, _p: [4e-5, 0, 0] if (f, k) == ("hole", 1) else 0),
    "long diagonal": (
        "diagonal",
        lambda f, k, p: 4e-3 * (p - [0.036, -0.046, p[2]]) if f == "hole" and k % 2 else 0,
    ),
    "worn flat": ("flats", lambda f, k, _p: [5e-5, 0, 0] if (f, k) == ("flat", 0) else 0),
    "bent": ("position", lambda f, _k, _p: [5e-5, 0, 0] if f in ("top", "hole", "flat") else 0),
    "shortened": ("height", lambda f, _k, _p: [0, 0, -5e-5] if f == "top" else 0),
    "turned": ("rotation", lambda f, k, _p: [0, 5e-5 * (-1) ** k, 0] if f == "flat" else 0),
}


@pytest.mark.parametrize("what", BENT)
def test_a_damaged_pillar_is_named_and_no_other(tmp_path: Path, what: str) -> None:
    words, by = BENT[what]

    def damage(feature: str, name: str, index: int, point: FloatArray) -> FloatArray:
        return point + (by(feature, index, point) if name == "L1" else 0)

    assert certified(tmp_path, options=DRAWN).damaged == ()
    found = certified(tmp_path, damage, options=DRAWN)
    assert found.damaged == ("L1",)
    assert any(words in fault.what for fault in found.faults)
    assert found.assessment.level == "bad"
    for tolerance in (1e-3, 1e-5):
        options = replace(DRAWN, tolerance=tolerance)
        assert bool(certified(tmp_path, damage, options=options).damaged) == (tolerance < 1e-4)


def test_what_a_workshop_scatters_is_not_damage(tmp_path: Path) -> None:
    """Every pillar departs from the drawing by far more than the touches scatter."""
    random = np.random.default_rng(4)
    off = {name: 2e-5 * random.standard_normal(3) for name in truth().landmarks}

    def made(feature: str, name: str, index: int, point: FloatArray) -> FloatArray:
        return point + off.get(name, 0)

    found = certified(tmp_path, made, options=DRAWN)
    assert found.damaged == ()
    assert 1e-5 < found.comparison.rms < 6e-5


@pytest.mark.parametrize("index", range(5))
def test_a_slip_on_a_top_is_found_and_left_out(tmp_path: Path, index: int) -> None:
    found = certified(tmp_path, moved([0, 0, -2e-5], "top", "L2", [index]))
    mark = {m.name: m for m in found.landmarks}["L2"]
    raw = read_raw_points(tmp_path / "points.csv")
    tops = {pillar.name: pillar.top for pillar in raw.pillars}
    assert mark.wrong_touches == (tops["L2"].lines[index],)
    assert mark.position[2] == pytest.approx(0.06, abs=4 * mark.std[2])
    assert found.damaged == ()
    assert found.assessment.level == "care"


def test_wrong_touches_of_ground_and_side_are_left_out(tmp_path: Path) -> None:
    ground, side = moved([0, 0, 5e-4], "ground", "", [3, 17]), moved([0, -2e-4, 0], "side", "", [4])
    found = certified(tmp_path, lambda f, n, k, point: side(f, n, k, ground(f, n, k, point)))
    assert len(found.ground.wrong_touches) == 2
    assert len(found.side.wrong_touches) == 1
    assert np.abs(positions(found) - TRUE_POSITIONS).max() < 1e-5


def test_a_side_that_leans_gives_its_line_in_the_ground(tmp_path: Path) -> None:
    """Touches lie higher at one end: their projection would turn with the lean."""

    def lean(feature: str, name: str, k: int, point: FloatArray) -> FloatArray:
        if feature != "side":
            return point
        return point + np.array([0, 0.05 * (point[2] + 0.05 * point[0]), 0.05 * point[0]])

    found = certified(tmp_path, lean, noise=1e-8)
    assert np.abs(positions(found) - TRUE_POSITIONS).max() < 1e-6


def test_without_a_side_the_direction_is_a_convention(tmp_path: Path) -> None:
    found = certified(tmp_path, leave_out=("side", "spacer"))
    assert found.heading == "farthest landmark"
    far = positions(found)[4]
    assert far[0] == pytest.approx(np.hypot(0.064, 0.062), abs=1e-5)
    assert far[1] == pytest.approx(0.0, abs=1e-12)
    assert found.landmarks[4].std[1] == pytest.approx(0.0, abs=1e-12)
    assert "convention" in found.assessment.notes[0]
    drawn = certified(tmp_path, leave_out=("side",), options=DRAWN)
    assert np.abs(positions(drawn) - TRUE_POSITIONS).max() < 1e-5


TWICE = "times as far apart"
ALONG = "times along (1.00, 0.00, 0.00)"


@pytest.mark.parametrize(
    ("scale", "level", "notes"),
    [
        (1.0, "good", []),
        (1.0015, "care", [TWICE]),
        (0.985, "bad", [TWICE]),
        # As an instrument has it of which one axis counts too much; its mean says less.
        ([1.015, 1.0, 1.0], "bad", [ALONG]),
    ],
)
def test_a_scale_between_artefact_and_drawing_is_told(
    tmp_path: Path, scale: float | list[float], level: str, notes: list[str]
) -> None:
    """An instrument's scale, or a wrong unit: no rigid superposition makes up for it."""
    marks = {n: replace(m, position=m.position * scale) for n, m in truth().landmarks.items()}
    options = CertificationOptions(drawing=Artefact("drawing", marks))
    assessment = certified(tmp_path, options=options).assessment
    assert assessment.level == level
    for words in (TWICE, ALONG):
        assert any(words in note for note in assessment.notes) == (words in notes)


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_any_side_may_be_the_one_touched_if_there_is_a_drawing(
    tmp_path: Path, degrees: int
) -> None:
    turn = rotation_from_rpy(np.radians([0.0, 0.0, degrees]))
    marks = truth().landmarks.items()
    turned = {n: Landmark(n, turn @ m.position, turn @ m.rotation) for n, m in marks}
    drawing = Artefact("turned", turned)
    found = certified(tmp_path, options=CertificationOptions(drawing=drawing))
    expected = np.array([m.position for m in drawing.landmarks.values()])
    assert np.abs(positions(found) - expected).max() < 1e-5
    assert found.turned == degrees // 90
    assert np.abs(found.comparison.turn).max() < 1e-3


def test_without_flats_there_is_no_rotation(tmp_path: Path) -> None:
    found = certified(tmp_path, leave_out=("flat",))
    assert all(mark.rotation is None for mark in found.landmarks)
    assert any("flats" in note for note in found.assessment.notes)


def test_options(tmp_path: Path) -> None:
    options = CertificationOptions(
        name="mine", origin="M1", probe_radius=1e-3, front=np.pi / 2, spacers={"A": 0.0379}
    )
    found = certified(tmp_path, options=options)
    expected = TRUE_POSITIONS - TRUE_POSITIONS[1] * [1, 1, 0]
    assert np.abs(positions(found) - expected).max() < 1e-5
    yaw = np.array([mark.yaw for mark in found.landmarks])
    np.testing.assert_allclose(wrap(yaw + np.pi / 2 - yaws(truth())), 0.0, atol=1e-3)
    assert found.landmarks[0].flats == pytest.approx(8e-3, abs=1e-5)
    assert found.spacers[0].length == pytest.approx(0.038, abs=1e-5)
    assert any("Spacer A" in note for note in found.assessment.notes)
    common = certified(tmp_path, options=replace(DRAWN, front=np.pi))
    assert any("--front-deg" in note for note in common.assessment.notes)


def test_holes_out_of_order_are_refused(tmp_path: Path) -> None:
    text = Path(raw_points(tmp_path).path).read_text(encoding="utf-8")
    swapped = text.replace("hole,S1,1,", "hole,S1,X,").replace("hole,S1,2,", "hole,S1,1,")
    path = tmp_path / "swapped.csv"
    path.write_text(swapped.replace("hole,S1,X,", "hole,S1,2,"), encoding="utf-8")
    with pytest.raises(
        SamplesError, match=r"landmark 'S1'.*do not cross.*order around the pillar is 0 [23] 1"
    ) as e:
        certify(read_raw_points(path))
    assert "swapped.csv" in str(e.value)


@settings(max_examples=50)
@given(st.permutations(range(4)), st.floats(-3, 3), st.floats(0.6, 1.7))
def test_only_neighbours_in_order_make_diagonals_that_cross(
    order: list[int], turn: float, stretch: float
) -> None:
    square = np.array([[1, 0, 0], [0, stretch, 0], [-1, 0, 0], [0, -stretch, 0]], dtype=float)
    holes = (square @ rotation_from_vector([0, 0, turn]).T)[order]
    in_order = (order[0] + order[2]) % 2 == 0
    assert diagonals_cross(holes, 0.2) == in_order
    assert (order_around(holes) in ((0, 1, 2, 3), (0, 3, 2, 1))) == in_order


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            st.sampled_from([*FEATURES, "toop"]),
            st.sampled_from(["", "O", "M1"]),
            st.sampled_from(["", "0", "1", "2", "3", "-1", "x", "1.5"]),
            st.sampled_from(["0", "0.1", "nan", "", "1e300", "0.05", "-0.02"]),
        ),
        max_size=30,
    )
)
def test_any_file_is_certified_or_refused(
    scratch: Path, drawn: list[tuple[str, str, str, str]]
) -> None:
    lines = [f"{f},{m},{i},{x},0.0{k},0.01" for k, (f, m, i, x) in enumerate(drawn)]
    scratch.write_text("\n".join(["feature,landmark,index,x,y,z", *lines]), encoding="utf-8")
    try:
        said = str(certify(read_raw_points(scratch)).path)
    except InputError as error:
        said = str(error)
    assert str(scratch) in said


def test_the_shape_does_not_know_where_the_artefact_stands() -> None:
    """Errors that are a motion of the whole vanish; what is left does not touch distances."""
    random = np.random.default_rng(0)
    places = random.uniform(-0.1, 0.1, (6, 3))
    motion = np.hstack([np.tile(np.eye(3), (6, 1)), np.vstack([-skew(p) for p in places])])
    moved = motion @ np.diag(random.uniform(1, 2, 6)) @ motion.T
    np.testing.assert_allclose(shape_covariance(places, moved), 0.0, atol=1e-12)
    covariance = np.diag(random.uniform(1, 2, 18))
    shape = shape_covariance(places, covariance + moved)
    difference = places[1] - places[4]
    by = np.zeros(18)
    by[3:6], by[12:15] = difference, -difference
    assert by @ shape @ by == pytest.approx(by @ covariance @ by)
