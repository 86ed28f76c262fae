"""What was observed: immutable, checked once when read, units known.

Names are imported when they are first used: who reads a YAML file need not wait for SciPy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.measurements.artefact import Artefact, Landmark, read_artefact, write_artefact
    from suta_calib.measurements.csv_table import CsvTable, read_csv_table
    from suta_calib.measurements.files import expand, read_text, write_text
    from suta_calib.measurements.pose_columns import (
        SutaCalibWarning,
        has_rotations,
        positions,
        rotations,
    )
    from suta_calib.measurements.sample_files import (
        JointRange,
        SampleColumns,
        read_samples,
        write_samples,
    )
    from suta_calib.measurements.samples import Samples
    from suta_calib.measurements.yaml_document import YamlDocument, read_yaml
    from suta_calib.measurements.yaml_section import YamlSection

_HOMES = {
    "artefact": ("Artefact", "Landmark", "read_artefact", "write_artefact"),
    "csv_table": ("CsvTable", "read_csv_table"),
    "files": ("expand", "read_text", "write_text"),
    "pose_columns": ("SutaCalibWarning", "has_rotations", "positions", "rotations"),
    "sample_files": ("JointRange", "SampleColumns", "read_samples", "write_samples"),
    "samples": ("Samples",),
    "yaml_document": ("YamlDocument", "read_yaml"),
    "yaml_section": ("YamlSection",),
}

__all__ = [
    "Artefact",
    "CsvTable",
    "JointRange",
    "Landmark",
    "SampleColumns",
    "Samples",
    "SutaCalibWarning",
    "YamlDocument",
    "YamlSection",
    "expand",
    "has_rotations",
    "positions",
    "read_artefact",
    "read_csv_table",
    "read_samples",
    "read_text",
    "read_yaml",
    "rotations",
    "write_artefact",
    "write_samples",
    "write_text",
]

__getattr__ = lazily(__name__, _HOMES)
