"""Acceptance test of an articulated arm after ISO 10360-12: errors, limits, decisions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
