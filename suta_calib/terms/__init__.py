"""Kinds of observation, and what is common to them. `kinds.py` has the list.

Names are imported when they are first used, so that only the needed kinds are loaded.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
