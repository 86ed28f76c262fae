"""The factory's calibration of a Universal Robots arm: two files, one arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign_samples import ur_kinematics
from scipy.spatial.transform import Rotation

from suta_calib import ArmModel
from suta_calib.errors import InputError
from suta_calib.exchange import read_foreign

ZERO = "[mounting]\n" + "".join(
    f"delta_{name} = [ 0.0, 0.0, 0.0, 0.0, 0.0, 0.0 ]\n" for name in ("theta", "a", "d", "alpha")
)


def test_the_yaml_and_the_deltas_are_the_same_arm(tmp_path: Path) -> None:
    by_links = ArmModel.from_urdf(read_foreign(ur_kinematics(tmp_path).path).text(), tip="tool0")
    path = tmp_path / "calibration.conf"
    path.write_text(ZERO)
    by_table = ArmModel.from_urdf(read_foreign(path, robot="ur5").text(), tip="tip")
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    for one, other in zip(by_links.forward(q), by_table.forward(q), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_delta_is_added_to_the_table(tmp_path: Path) -> None:
    path = tmp_path / "calibration.conf"
    path.write_text(ZERO.replace("delta_theta = [ 0.0", "delta_theta = [ 0.1"))
    arm = ArmModel.from_urdf(read_foreign(path, robot="UR5e").text(), tip="tip")
    path.write_text(ZERO)
    nominal = ArmModel.from_urdf(read_foreign(path, robot="ur5e").text(), tip="tip")
    q = np.array([0.2, -1.0, 1.0, 0.3, 0.4, 0.5])
    turn = Rotation.from_euler("z", 0.1).as_matrix()
    np.testing.assert_allclose(arm.forward(q)[1], turn @ nominal.forward(q)[1], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        (ZERO, {}, r"--robot: found none; expected one of ur3, .*only differences"),
        (ZERO, {"robot": "ur99"}, "found 'ur99'"),
        (ZERO.replace("delta_a = [ 0.0,", "delta_a = ["), {"robot": "ur5"}, "delta_a: .*six numb"),
        (ZERO.replace("0.0 ]", "nan ]"), {"robot": "ur5"}, "delta_theta: .*six numbers"),
    ],
)
def test_what_is_refused(text: str, options: dict[str, str], says: str, tmp_path: Path) -> None:
    path = tmp_path / "calibration.conf"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        read_foreign(path, **options)


def test_a_link_without_origin_is_named(tmp_path: Path) -> None:
    path = ur_kinematics(tmp_path).path
    path.write_text(path.read_text().replace("  forearm:", "  other:"))
    with pytest.raises(InputError, match=r"forearm: found none; expected finite numbers x, y"):
        read_foreign(path)
