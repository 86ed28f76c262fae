"""How far a result can be trusted: one statistical test, and the hypotheses that it checks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
