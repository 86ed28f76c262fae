"""Encoders on a cable: their description, their bytes, their port.

Names are imported when they are first used: a process that only reads a port starts at once.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
