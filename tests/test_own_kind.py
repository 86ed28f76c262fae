"""The tutorial *Write your own kind of observation* runs as it stands there.

`examples/height_gauge` is not installed: a process of its own finds it as if it were.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from shown_blocks import BLOCKS, words

PAGE = "docs/tutorials/own_kind.md"
# Runs command lines, and then lines of Python with readings and ideal heights of the simulated arm.
PROGRAM = """
import json, sys
import numpy as np
from suta_calib import ArmModel
from suta_calib.cli._app import run

lines, python = json.load(sys.stdin)
for line in lines:
    assert run(line) == 0, line
arm = ArmModel.from_urdf("my_arm.urdf", tip="tool0")
q = np.random.default_rng(0).uniform(-1.5, 1.5, (80, len(arm.joints)))
heights = arm.forward(q, {"joint_3.offset": 0.01})[1][:, 2] - 0.2
exec(python)
assert abs(result.solution.values["plate.z"] - 0.2) < 0.01
ideal = gauged.observed(result.solution.values, gauged.poses).numbers["height"]
assert np.abs(ideal - heights).max() < 1e-4
"""


def installed(package: Path, folder: Path) -> None:
    """What `pip install -e` writes for the entry points of a package."""
    project = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    entry = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    entry.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (entry / "METADATA").write_text(metadata)
    sections = project["entry-points"].items()
    text = "".join(
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        for group, points in sections
    )
    (entry / "entry_points.txt").write_text(text)


def test_the_commands_and_the_python_of_the_page_run(repository: Path, tmp_path: Path) -> None:
    package = repository / "examples/height_gauge"
    installed(package, tmp_path)
    arm = (repository / "urdf/suta.urdf").read_text(encoding="utf-8").replace('"tip"', '"tool0"')
    (tmp_path / "my_arm.urdf").write_text(arm, encoding="utf-8")
    blocks = [block for block in BLOCKS if block.page == PAGE]
    for block in blocks:
        for name, text in re.findall(r"^cat > (\S+) <<'END'\n(.*?)^END$", block.text, re.M | re.S):
            (tmp_path / name).write_text(text, encoding="utf-8")
    lines = [words(line) for block in blocks for line in block.commands]
    assert len(lines) == 3
    (python,) = (block.text for block in blocks if block.language == "python")
    path = os.pathsep.join([str(package), str(tmp_path), str(repository)])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input=json.dumps([lines, python]),
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "heights/results/result.json").read_text(encoding="utf-8"))
    assert result["verdict"]["level"] == "good"
    assert "0.025 mm RMS" in (repository / PAGE).read_text(encoding="utf-8")
    assert "→ 0.025 mm RMS on 20 " in done.stdout
