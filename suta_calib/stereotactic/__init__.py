"""The JHU CIS stereotactic navigation problem: two trackers, distortion, and registration to CT."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
