"""What was observed: immutable, checked once when read, units known.

Names are imported when they are first used: who reads a YAML file need not wait for SciPy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.measurements.artefact import Artefact as Artefact
    from suta_calib.measurements.artefact import Landmark as Landmark
    from suta_calib.measurements.artefact import read_artefact as read_artefact
    from suta_calib.measurements.artefact import write_artefact as write_artefact
    from suta_calib.measurements.board import Board as Board
    from suta_calib.measurements.board import Charuco as Charuco
    from suta_calib.measurements.board import Chessboard as Chessboard
    from suta_calib.measurements.board import Marker as Marker
    from suta_calib.measurements.board import Markers as Markers
    from suta_calib.measurements.board import read_board as read_board
    from suta_calib.measurements.board import write_board as write_board
    from suta_calib.measurements.camera import Camera as Camera
    from suta_calib.measurements.camera import read_camera as read_camera
    from suta_calib.measurements.camera import write_camera as write_camera
    from suta_calib.measurements.corners import Corners as Corners
    from suta_calib.measurements.corners import corners_of as corners_of
    from suta_calib.measurements.corners import read_corners as read_corners
    from suta_calib.measurements.corners import write_corners as write_corners
    from suta_calib.measurements.csv_table import CsvTable as CsvTable
    from suta_calib.measurements.csv_table import has_rotations as has_rotations
    from suta_calib.measurements.csv_table import positions as positions
    from suta_calib.measurements.csv_table import read_csv_table as read_csv_table
    from suta_calib.measurements.csv_table import rotations as rotations
    from suta_calib.measurements.files import expand as expand
    from suta_calib.measurements.files import lines_of as lines_of
    from suta_calib.measurements.files import read_text as read_text
    from suta_calib.measurements.files import write_text as write_text
    from suta_calib.measurements.pose_files import ToolPoses as ToolPoses
    from suta_calib.measurements.sample_files import JointRange as JointRange
    from suta_calib.measurements.sample_files import SampleColumns as SampleColumns
    from suta_calib.measurements.sample_files import check_readings as check_readings
    from suta_calib.measurements.sample_files import read_samples as read_samples
    from suta_calib.measurements.sample_files import write_samples as write_samples
    from suta_calib.measurements.samples import Samples as Samples
    from suta_calib.measurements.scale import GRADES as GRADES
    from suta_calib.measurements.scale import LengthScale as LengthScale
    from suta_calib.measurements.yaml_file import YamlDocument as YamlDocument
    from suta_calib.measurements.yaml_file import YamlSection as YamlSection
    from suta_calib.measurements.yaml_file import read_yaml as read_yaml

__getattr__, __all__ = public(__name__)
