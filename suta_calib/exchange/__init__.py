"""Reads and writes files of other programs: one module for each format, with its help texts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
