"""From terms to a solution: problem, evaluation, minimisation, verdict.

Names are imported when they are first used. `suta_calib.solve` starts it all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
