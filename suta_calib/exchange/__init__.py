"""Into and out of the files of other programs: one module per format, each describing itself."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
