"""Simulated measurements: any arm, any artefact, known truth.

Names are imported when they are first used, so that inverse kinematics loads no simulation.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
