"""The arm whose geometry is unknown: a chain of a URDF, its parameters, its kinematics."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
