"""What was observed: immutable, checked once when read, units known.

Names are imported when they are first used: who reads a YAML file need not wait for SciPy.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
