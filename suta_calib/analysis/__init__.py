"""Analyses of a calibration: errors, outliers, plans, studies.

Names are imported when they are first used. The analyses themselves are `suta_calib.error_budget`
and `suta_calib.tip_map`; larger ones have a package of their own.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
