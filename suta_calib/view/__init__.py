"""An arm one can look at, in 3-D: in the browser, or in one file that opens offline (an extra)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
