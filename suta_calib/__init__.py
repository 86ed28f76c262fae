"""Kinematic calibration of serial arms from their URDF.

A few lines do what the command line does::

    arm = ArmModel.from_urdf("arm.urdf", tip="tip")
    unknowns = arm.select(Selection(("*.offset",), bound_rad=0.26), "joint_4.z")
    poses = ArmPoses(arm, samples)
    problem = Problem([PairwiseDistance(poses, artefact, Noise(huber=1.35e-3))], unknowns)
    solution = solve(problem, SolverOptions(starts=8))
    print(solution.sentence, solution.unidentified)
    arm.write_urdf("calibrated.urdf", solution.values)
"""

import lazy_loader

# `pyproject.toml` has it from here: to look for it among what is installed takes long.
__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
