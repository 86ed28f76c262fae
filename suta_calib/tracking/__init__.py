"""A calibrated arm live: poses with their uncertainty, to files and networks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.tracking.igtl import IgtlPublisher
    from suta_calib.tracking.latency import LatencyStatistics
    from suta_calib.tracking.live import Tracking, TrackOptions
    from suta_calib.tracking.path_accuracy import compare
    from suta_calib.tracking.publisher import Publisher, UdpPublisher
    from suta_calib.tracking.recording import CsvRecorder, ParquetRecorder
    from suta_calib.tracking.session import TrackingSession, low_latency
    from suta_calib.tracking.tracker import TipKinematics, Tool, TrackedPose, Tracker, read_tool
    from suta_calib.tracking.trajectory import Trajectory, read_trajectory
    from suta_calib.tracking.uncertainty import CalibrationUncertainty, read_uncertainty

_HOMES = {
    "igtl": ("IgtlPublisher",),
    "latency": ("LatencyStatistics",),
    "live": ("TrackOptions", "Tracking"),
    "path_accuracy": ("compare",),
    "publisher": ("Publisher", "UdpPublisher"),
    "recording": ("CsvRecorder", "ParquetRecorder"),
    "session": ("TrackingSession", "low_latency"),
    "tracker": ("TipKinematics", "Tool", "TrackedPose", "Tracker", "read_tool"),
    "trajectory": ("Trajectory", "read_trajectory"),
    "uncertainty": ("CalibrationUncertainty", "read_uncertainty"),
}

__all__ = [
    "CalibrationUncertainty",
    "CsvRecorder",
    "IgtlPublisher",
    "LatencyStatistics",
    "ParquetRecorder",
    "Publisher",
    "TipKinematics",
    "Tool",
    "TrackOptions",
    "TrackedPose",
    "Tracker",
    "Tracking",
    "TrackingSession",
    "Trajectory",
    "UdpPublisher",
    "compare",
    "low_latency",
    "read_tool",
    "read_trajectory",
    "read_uncertainty",
]

__getattr__ = lazily(__name__, _HOMES)
