"""How many sets a calibration needs, and how much its answer varies: trials run anywhere."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
