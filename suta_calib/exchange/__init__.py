"""Into and out of the files of other programs: one module per format, each describing itself.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.exchange.imported import Imported as Imported
    from suta_calib.exchange.imported import ImportedFile as ImportedFile
    from suta_calib.exchange.imported import ImportedRows as ImportedRows
    from suta_calib.exchange.reader import Reader as Reader
    from suta_calib.exchange.reader import import_formats as import_formats
    from suta_calib.exchange.reader import read_foreign as read_foreign
    from suta_calib.exchange.result import Result as Result
    from suta_calib.exchange.result import Transform as Transform
    from suta_calib.exchange.result import read_result as read_result
    from suta_calib.exchange.writer import Exported as Exported
    from suta_calib.exchange.writer import Writer as Writer
    from suta_calib.exchange.writer import export_formats as export_formats
    from suta_calib.exchange.writer import write_foreign as write_foreign

__getattr__, __all__ = public(__name__)
