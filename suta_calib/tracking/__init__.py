"""A calibrated arm live: poses with their uncertainty, to files and networks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.tracking.igtl import IgtlPublisher as IgtlPublisher
    from suta_calib.tracking.latency import LatencyStatistics as LatencyStatistics
    from suta_calib.tracking.live import Tracking as Tracking
    from suta_calib.tracking.live import TrackOptions as TrackOptions
    from suta_calib.tracking.path_accuracy import compare as compare
    from suta_calib.tracking.publisher import Publisher as Publisher
    from suta_calib.tracking.publisher import UdpPublisher as UdpPublisher
    from suta_calib.tracking.recording import CsvRecorder as CsvRecorder
    from suta_calib.tracking.recording import ParquetRecorder as ParquetRecorder
    from suta_calib.tracking.session import TrackingSession as TrackingSession
    from suta_calib.tracking.session import low_latency as low_latency
    from suta_calib.tracking.tracker import TipKinematics as TipKinematics
    from suta_calib.tracking.tracker import Tool as Tool
    from suta_calib.tracking.tracker import TrackedPose as TrackedPose
    from suta_calib.tracking.tracker import Tracker as Tracker
    from suta_calib.tracking.tracker import read_tool as read_tool
    from suta_calib.tracking.trajectory import Trajectory as Trajectory
    from suta_calib.tracking.trajectory import read_trajectory as read_trajectory
    from suta_calib.tracking.uncertainty import CalibrationUncertainty as CalibrationUncertainty
    from suta_calib.tracking.uncertainty import read_uncertainty as read_uncertainty

__getattr__, __all__ = public(__name__)
