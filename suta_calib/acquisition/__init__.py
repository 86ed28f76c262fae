"""From an arm at rest to samples: rests found and averaged, guided or unattended measuring."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
