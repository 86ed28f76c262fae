"""Pictures of numbers: what ``plot`` methods and the report draw, one file for each thing shown.

Nothing here knows an arm, a solution or an answer: these hand over arrays and names. Names are
imported when they are first used: who draws nothing need not wait for Matplotlib.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
