"""Hand-eye calibration of ten measured pairs of poses, of which a report prints another answer.

Maroufi and Yousaf, ME 384R, assignment 3 (2025), section 3.3. Its method is `quaternion_hand_eye`'s
but for one sign: it prints skew(vA - vB) where qA qX = qX qB gives skew(vA + vB).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.terms.hand_eye_start import Poses, quaternion_hand_eye

# X of the noise-free data, m.
PRINTED = (
    np.array([[-0.2136, 0.9769, 0.0], [-0.9769, -0.2136, 0.0], [0.0, 0.0, 1.0]]),
    np.array([0.0760, -0.0482, 0.0085]),
)


@pytest.fixture(scope="module")
def pairs(shared: Path) -> tuple[Poses, Poses]:
    """The ten noise-free pairs: poses of the hand and of the target."""
    file = shared / "hand_eye_rviz" / "clean.csv"
    if not file.is_file():
        pytest.skip("hand_eye_rviz is not among the measured data")
    table = np.loadtxt(file, delimiter=",", skiprows=1)

    def poses(columns: FloatArray) -> Poses:
        return Rotation.from_quat(columns[:, 3:]).as_matrix(), columns[:, :3]

    return poses(table[:, :7]), poses(table[:, 7:])


def turn(R: FloatArray, other: FloatArray) -> float:
    """Angle between two rotations, degrees."""
    return float(np.degrees(Rotation.from_matrix(R.T @ other).magnitude()))


def misfit(X: Poses, hand: Poses, seen: Poses) -> float:
    """RMS of AX - XB over consecutive motions, mm."""
    R, t = X
    found = []
    for i in range(len(hand[1]) - 1):
        RA = hand[0][i].T @ hand[0][i + 1]
        tA = hand[0][i].T @ (hand[1][i + 1] - hand[1][i])
        tB = seen[1][i] - seen[0][i] @ seen[0][i + 1].T @ seen[1][i + 1]
        found.append(RA @ t + tA - R @ tB - t)
    return 1e3 * float(np.sqrt(np.mean(np.sum(np.square(found), axis=1))))


def test_the_poses_determine_another_x(pairs: tuple[Poses, Poses]) -> None:
    X = quaternion_hand_eye(*pairs)
    assert turn(X[0], PRINTED[0]) == pytest.approx(101.4, abs=0.05)
    # Four other methods agree on an X with 3.06 mm.
    assert misfit(X, *pairs) == pytest.approx(3.06, abs=0.2)
    assert misfit(PRINTED, *pairs) == pytest.approx(574.5, abs=0.05)


@pytest.mark.parametrize("rows", [slice(5), slice(5, None)])
def test_halves_agree_with_the_whole(pairs: tuple[Poses, Poses], rows: slice) -> None:
    """Where the report concludes that they do not."""
    half = tuple((R[rows], p[rows]) for R, p in pairs)
    X = quaternion_hand_eye(*half)
    assert turn(X[0], quaternion_hand_eye(*pairs)[0]) < 0.5
    # Written to three decimals: half a unit of a quaternion is 0.7 mm at the target, per pose.
    assert misfit(X, *half) < 5.0
