"""LeRobot datasets: the rests of every episode, in rad."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from foreign import imported
from foreign_samples import lerobot_dataset
from ros_recordings import POSTURES

from suta_calib.errors import InputError

pytest.importorskip("pyarrow")


def test_the_rests_of_every_episode(tmp_path: Path) -> None:
    sample = lerobot_dataset(tmp_path)
    found = imported(sample.path, **sample.options, motors="joint_2=elbow")
    assert found.form == "lerobot-dataset"
    angles = np.stack([found.columns["joint_1"], found.columns["elbow"]], axis=1)
    np.testing.assert_allclose(angles, [*POSTURES, *POSTURES], atol=1e-9)


def test_what_the_states_are_is_asked(tmp_path: Path) -> None:
    sample = lerobot_dataset(tmp_path)
    with pytest.raises(InputError, match=r"--state-unit: found states without their unit"):
        imported(sample.path)


def test_datasets_that_cannot_be_used(tmp_path: Path) -> None:
    sample = lerobot_dataset(tmp_path)
    info = sample.path / "meta/info.json"
    good = info.read_text()
    told = json.loads(good)
    told["features"]["observation.state"]["names"] = ["one"]
    for text, says in (
        (json.dumps(told), r"states of shape \(\d+, 2\); expected 1 numbers"),
        ('{"features": {}}', "no list of motors"),
        ("{", r"info.json:1: found text that is not JSON"),
    ):
        info.write_text(text)
        with pytest.raises(InputError, match=says):
            imported(sample.path, **sample.options)
    info.write_text(json.dumps(json.loads(good) | {"total_frames": 10**6}))
    with pytest.raises(InputError, match=r"expected 1000000, as the file states"):
        imported(sample.path, **sample.options)
    info.write_text(good)
    outside = tmp_path / "outside.parquet"
    file = sample.path / "data/chunk-000/file-001.parquet"
    file.rename(outside)
    file.symlink_to(outside)
    with pytest.raises(InputError, match="a link to a place outside the folder"):
        imported(sample.path, **sample.options)
