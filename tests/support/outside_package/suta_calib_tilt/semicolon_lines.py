"""A device format: lines of numbers with semicolons between."""

from typing import ClassVar

from suta_calib.device import Reading
from suta_calib.device.formats import Decoder, Encoder, Sample
from suta_calib.device.formats.lines import LinesDecoder, LinesEncoder, LinesFormat


class SemicolonDecoder(LinesDecoder):
    """Reads ``1;2;3`` as ``1,2,3``."""

    def feed(self, data: bytes, arrival: float) -> list[Reading]:
        """Take the next bytes and give the readings they complete."""
        return super().feed(data.replace(b";", b","), arrival)


class SemicolonEncoder(LinesEncoder):
    """Writes ``1;2;3``, for `suta-calib emulate`."""

    def packet(self, sample: Sample) -> bytes:
        """The bytes of one sample."""
        return super().packet(sample).replace(b",", b";")


class SemicolonLines(LinesFormat):
    """Lines of text, a number per joint, with semicolons between."""

    name: ClassVar[str] = "semicolon-lines"
    decoder: ClassVar[type[Decoder]] = SemicolonDecoder
    encoder: ClassVar[type[Encoder]] = SemicolonEncoder

    def recognises(self, data: bytes) -> bool:
        """Printable text with a semicolon."""
        return b";" in data and super().recognises(data)
