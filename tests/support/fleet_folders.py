"""What stands in the folders of a fleet."""

from __future__ import annotations

import json
from pathlib import Path


def contents(folder: Path) -> dict[str, bytes]:
    """Of a folder's files; the times that a result.json holds are those of one run."""
    found = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    if "result.json" in found:
        record = json.loads(found["result.json"])
        assert record.pop("timing_s")
        found["result.json"] = json.dumps(record).encode()
    return found


def jobs_in(folder: Path) -> list[Path]:
    return sorted(path.relative_to(folder) for path in folder.glob("*/calibration.yaml"))
