"""Lenses: OpenCV's pixels, and back from them; derivatives; what is beside the camera."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.arrays import FloatArray
from suta_calib.geometry.lens import EQUIDISTANT, LENSES, PLUMB_BOB, RATIONAL, Lens, lens_called
from suta_calib.geometry.lens_slopes import pixel_slopes

VALUES = {
    "plumb_bob": [600, 610, 320, 240, -0.2, 0.05, 1e-3, -2e-3, 0.01],
    "rational_polynomial": [600, 610, 320, 240, 0.5, -0.05, 1e-3, -2e-3, 0.01, 0.8, 0.05, 0.02],
    "equidistant": [300, 305, 320, 240, 0.02, -0.01, 0.003, -0.0005],
}
each_lens = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)


def intrinsics(lens: Lens) -> FloatArray:
    return np.array(VALUES[lens.name], dtype=float)


@each_lens
def test_it_is_opencvs(lens: Lens) -> None:
    cv2 = pytest.importorskip("cv2")
    points = np.random.default_rng(0).uniform([-1, -1, 1], [1, 1, 2], (500, 3))
    values = intrinsics(lens)
    matrix = np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1.0]])
    still = np.zeros(3), np.zeros(3), matrix, values[4:]
    if lens is EQUIDISTANT:
        expected = cv2.fisheye.projectPoints(points[None], *still)[0][0]
    else:
        expected = cv2.projectPoints(points, *still)[0][:, 0]
    np.testing.assert_allclose(lens.projected(points, values), expected, atol=1e-11)


@each_lens
@given(x=st.floats(-0.9, 0.9), y=st.floats(-0.9, 0.9), depth=st.floats(1e-3, 1e3))
def test_there_and_back(lens: Lens, x: float, y: float, depth: float) -> None:
    values, point = intrinsics(lens), np.array([x * depth, y * depth, depth])
    pixel = lens.projected(point, values)
    length = np.linalg.norm(point)
    np.testing.assert_allclose(lens.directions(pixel, values), point / length, atol=1e-12)
    np.testing.assert_allclose(lens.undistorted(pixel, values), [x, y], atol=1e-11)


def test_a_fisheye_sees_beside_itself() -> None:
    values, angle = intrinsics(EQUIDISTANT), np.radians([0.0, 1e-7, 60.0, 90.0, 100.0, 110.0])
    points = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    assert EQUIDISTANT.ahead(points).all()
    assert not EQUIDISTANT.ahead(np.array([0.0, 0.1, -1.0]))
    pixels = EQUIDISTANT.projected(points, values)
    assert (np.diff(pixels[:, 0]) > 0).all()
    np.testing.assert_allclose(EQUIDISTANT.directions(pixels, values), points, atol=1e-12)
    assert np.isnan(EQUIDISTANT.undistorted(pixels, values)[3:]).all()
    for lens in (PLUMB_BOB, RATIONAL):
        np.testing.assert_array_equal(lens.ahead(points), points[:, 2] > 0)


@each_lens
def test_slopes_are_differences(lens: Lens) -> None:
    points = np.random.default_rng(1).uniform([-1, -1, 1], [1, 1, 2], (7, 3))
    values = intrinsics(lens)
    by_point, by_values = pixel_slopes(lens, points, values)
    for k, step in enumerate(1e-6 * np.eye(3)):
        ahead, behind = (lens.projected(points + s * step, values) for s in (1, -1))
        np.testing.assert_allclose(by_point[..., k], (ahead - behind) / 2e-6, atol=1e-5)
    for k, step in enumerate(1e-6 * np.eye(len(values))):
        ahead, behind = (lens.projected(points, values + s * step) for s in (1, -1))
        np.testing.assert_allclose(by_values[..., k], (ahead - behind) / 2e-6, atol=1e-5)
    assert [part.shape for part in pixel_slopes(lens, points[:0], values)] == [
        (0, 2, 3),
        (0, 2, len(values)),
    ]


def test_lenses_have_other_names() -> None:
    assert lens_called("radtan") is PLUMB_BOB
    assert lens_called("fisheye") is EQUIDISTANT
    assert lens_called("thin_prism") is None
