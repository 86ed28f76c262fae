"""Whether a calibration is still right, by a few new rows: what changed, and what was repaired."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
