"""Kinematic calibration of serial arms from their URDF.

A few lines do what the command line does::

    arm = ArmModel.from_urdf("arm.urdf", tip="tool0")
    fitted = TrackedPoint.from_arrays(arm, q, position=p)
    held_out = TrackedPoint.from_arrays(arm, q2, position=p2)
    result = calibrate(arm, [fitted], validation=[held_out])
    print(result.assessment)
    result.write_urdf("calibrated.urdf")
"""

import lazy_loader

# `pyproject.toml` has it from here: to look for it among what is installed takes long.
__version__ = "1.0.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
