"""Jobs: files that say what to calibrate or to test, read once, typed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
