"""Rotations and rigid transforms: `numbers` in NumPy, `symbols` in CasADi.

Convention, stated once for the whole package: ``T_a_b`` is the pose of b in a, so it maps
coordinates in b into a and products cancel on the page: ``T_a_c = T_a_b @ T_b_c``. A pose is a
rotation matrix ``R`` (3x3) with a position ``p`` (3,), in m; a rotation vector is in rad;
quaternions are ``x y z w``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
