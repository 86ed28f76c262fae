"""An answer on paper: a certificate as PDF and as JSON, made of the files that a command wrote."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
