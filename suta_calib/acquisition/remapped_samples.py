"""Samples that were read before the motors were mapped, as the corrected device gives them."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from pathlib import Path

from suta_calib.acquisition.motor_mapping import MotorMap
from suta_calib.errors import SamplesError
from suta_calib.inputs import read_input
from suta_calib.measurements.csv_table import read_csv_table


def remapped(mapping: MotorMap, job: Path, files: Iterable[Path]) -> dict[str, str]:
    """Text of each samples file with the readings of the corrected device, by name.

    Names are relative to the job's folder. Everything but the columns of the joints stays.

    Raises:
        SamplesError: a file without a column in rad for each joint.
    """
    joints, texts = mapping.arm.joints, dict[str, str]()
    for file in dict.fromkeys(files):
        if b"\n" not in read_input(file).strip():
            # A header alone, as a new job has it.
            continue
        table = read_csv_table(file)
        for joint in joints:
            if joint not in table.columns:
                expected = f"a column {joint}, in rad, to put its motor's readings in"
                raise SamplesError(f"the columns {', '.join(table.columns)}", expected, file=file)
        columns = {name: list(table.cells(name)) for name in table.columns}
        for joint, angles in mapping.reread({j: table.numbers(j) for j in joints}).items():
            columns[joint] = [repr(float(angle)) for angle in angles]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
        name = os.path.relpath(file, job.parent)
        texts[file.name if name.startswith("..") else name] = text.getvalue()
    return texts
