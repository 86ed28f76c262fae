"""What a fit and its data say of each other: errors, repeats, what is missing, what is open."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
