"""Rotations and rigid transforms: `numbers` in NumPy, `symbols` in CasADi.

Convention, stated once for the whole package: ``T_a_b`` is the pose of b in a, so it maps
coordinates in b into a and products cancel on the page: ``T_a_c = T_a_b @ T_b_c``. A pose is a
rotation matrix ``R`` (3x3) with a position ``p`` (3,), in m; a rotation vector is in rad;
quaternions are ``x y z w``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.geometry.numbers import extent as extent
    from suta_calib.geometry.numbers import homogeneous as homogeneous
    from suta_calib.geometry.numbers import quaternion_from_rotation as quaternion_from_rotation
    from suta_calib.geometry.numbers import register_points as register_points
    from suta_calib.geometry.numbers import right_singular as right_singular
    from suta_calib.geometry.numbers import rms_length as rms_length
    from suta_calib.geometry.numbers import rotation_from_quaternion as rotation_from_quaternion
    from suta_calib.geometry.numbers import rotation_from_rpy as rotation_from_rpy
    from suta_calib.geometry.numbers import rotation_from_vector as rotation_from_vector
    from suta_calib.geometry.numbers import rpy_from_rotation as rpy_from_rotation
    from suta_calib.geometry.numbers import skew as skew
    from suta_calib.geometry.numbers import vector_from_rotation as vector_from_rotation
    from suta_calib.geometry.numbers import wrap as wrap
    from suta_calib.geometry.pinhole import projected as projected
    from suta_calib.geometry.pinhole import undistorted as undistorted
    from suta_calib.geometry.symbols import symbolic_chordal_log as symbolic_chordal_log
    from suta_calib.geometry.symbols import symbolic_rotation as symbolic_rotation
    from suta_calib.geometry.symbols import symbolic_skew as symbolic_skew

__getattr__, __all__ = public(__name__)
