"""Names that say what columns are, above the rows or in a comment; and those that do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported, poses, written
from scipy.spatial.transform import Rotation

from suta_calib.errors import InputError

R, P = poses()
XYZW = Rotation.from_matrix(R).as_quat()
TIME = np.arange(len(P))[:, None]
TUM = "# timestamp tx ty tz qx qy qz qw"
EUROC = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
)


def test_a_trajectory_of_tum(tmp_path: Path) -> None:
    rows = np.hstack([1305031102.0 + TIME / 64, P, XYZW])
    path = written(tmp_path / "t.txt", rows, " ", f"# ground truth\n# file: 'a.bag'\n{TUM}")
    found = imported(path)
    check(found, tmp_path / "o.csv", R, P)
    np.testing.assert_array_equal(found.columns["time"], rows[:, 0])


def test_a_trajectory_without_names_is_asked_about(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", np.hstack([TIME, P, XYZW]), " ")
    way = "1=time,2=x,3=y,4=z,5=qx,6=qy,7=qz,8=qw"
    with pytest.raises(InputError, match=f"--columns {way} for a TUM trajectory"):
        imported(path)
    check(imported(path, columns=way), tmp_path / "o.csv", R, P)


@pytest.mark.parametrize("more", ["", ",v_RS_R_x [m s^-1],b_w_RS_S_x [rad s^-1]"])
def test_ground_truth_of_euroc(more: str, tmp_path: Path) -> None:
    rows = np.hstack([1e9 + 5e6 * TIME, P, np.roll(XYZW, 1, axis=1)])
    if more:
        rows = np.hstack([rows, P[:, :2]])
    path = written(tmp_path / "data.csv", rows, ",", EUROC + more)
    found = imported(path)
    check(found, tmp_path / "o.csv", R, P)
    np.testing.assert_allclose(found.columns["time"], 1.0 + 0.005 * TIME[:, 0])
    assert not any("RS_R" in name for name in found.columns if "[m s" not in name)


def test_a_comment_that_names_no_columns_is_a_comment(tmp_path: Path) -> None:
    rows = np.hstack([P, XYZW])
    path = written(tmp_path / "t.txt", rows, " ", "# seven words about the poses of tool\n")
    check(imported(path, rotation="xyzw"), tmp_path / "o.csv", R, P)
    path = written(tmp_path / "t.txt", rows, " ", "# x y z qx qy qz qw")
    check(imported(path), tmp_path / "o.csv", R, P)
    with pytest.raises(InputError, match="--rotation xyzw"):
        imported(path, header="no")


@pytest.mark.parametrize("angles", [True, False])
def test_a_marker_of_figaroh_beside_joints(angles: bool, tmp_path: Path) -> None:
    """Twelve columns with names are no matrix because they are twelve."""
    numbers = [P, Rotation.from_matrix(R).as_euler("xyz")][: 1 + angles]
    header = ["x1", "y1", "z1", "phix1", "phiy1", "phiz1"][: 3 * len(numbers)]
    rows = np.hstack([*numbers, np.ones((len(P), 6))])
    header += [f"joint_{k}" for k in range(1, 7)]
    path = written(tmp_path / "t.csv", rows, ",", ",".join(header))
    found = imported(path)
    check(found, tmp_path / "o.csv", R if angles else None, P)
    assert "joint_6" in found.columns
    if angles:
        way = "x1=x,y1=y,z1=z,phix1=roll,phiy1=pitch,phiz1=yaw"
        found = imported(path, columns=way, unit="rad", rotation="xyz")
        check(found, tmp_path / "o.csv", R, P)


def test_several_markers_of_figaroh_are_asked_about(tmp_path: Path) -> None:
    header = ",".join(f"{axis}{k}" for k in (1, 2) for axis in "xyz") + ",arm_1_joint"
    path = written(tmp_path / "t.csv", np.hstack([P, P + 0.1, TIME]), ",", header)
    with pytest.raises(InputError, match=r"2 bodies or markers: 1, 2; .*--body NAME"):
        imported(path)
    check(imported(path, body="2"), tmp_path / "o.csv", None, P + 0.1)
    both = imported(path, body="*")
    assert list(dict.fromkeys(both.columns["target"].tolist())) == ["1", "2"]
    assert len(both.columns["arm_1_joint"]) == 2 * len(P)
