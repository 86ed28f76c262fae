"""Many jobs in one command: each in a worker process of its own, and one summary of them all."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
