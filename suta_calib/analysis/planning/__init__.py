"""Where to measure next: which placements, points or poses shrink the uncertainty most."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
