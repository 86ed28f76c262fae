"""Into and out of the files of other programs: one module per format, each describing itself.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.exchange.imported import Imported as Imported
    from suta_calib.exchange.imported import ImportedRows as ImportedRows
    from suta_calib.exchange.reader import Reader as Reader
    from suta_calib.exchange.reader import read_foreign as read_foreign
    from suta_calib.exchange.reader import readers as readers

__getattr__, __all__ = public(__name__)
