"""How far an answer may be trusted: one statistical test, and what it is asked about."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
