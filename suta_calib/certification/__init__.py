"""An artefact certified from raw points: its landmarks, their uncertainty, and what is damaged."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
