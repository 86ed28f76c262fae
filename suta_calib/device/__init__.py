"""Encoders on a cable: their description, their bytes, their port.

Names are imported when they are first used: a process that only reads a port starts at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.device.bus import Bus as Bus
    from suta_calib.device.description import DeviceSpec as DeviceSpec
    from suta_calib.device.description import JointSpec as JointSpec
    from suta_calib.device.device_file import read_device as read_device
    from suta_calib.device.formats import FORMATS as FORMATS
    from suta_calib.device.formats import Decoder as Decoder
    from suta_calib.device.formats import Encoder as Encoder
    from suta_calib.device.formats import Format as Format
    from suta_calib.device.formats import decoder_for as decoder_for
    from suta_calib.device.formats import encode_frame as encode_frame
    from suta_calib.device.formats import encode_line as encode_line
    from suta_calib.device.formats.words import frame_crc as frame_crc
    from suta_calib.device.monitoring import Monitor as Monitor
    from suta_calib.device.monitoring import stream_report as stream_report
    from suta_calib.device.monitoring import watch as watch
    from suta_calib.device.reading import Reading as Reading
    from suta_calib.device.reading import Statistics as Statistics
    from suta_calib.device.units import angles_from_counts as angles_from_counts

__getattr__, __all__ = public(__name__)
