"""Repeatability of visits to one point, or of touches of many, and of encoders at rest."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
