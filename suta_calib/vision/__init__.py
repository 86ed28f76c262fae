"""Boards and their corners in pictures, and the camera they were taken with; needs OpenCV.

The extra ``vision`` installs it. Versions 4.8 to 5 are used by what they have in common.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
