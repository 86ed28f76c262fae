"""A job of tracked points for figaroh (PyPI), in an interpreter of its own.

    python figaroh_peer.py JOB.json     # prints one JSON object

JOB.json: `urdf`, `tip`, `level` ("joint_offset", "full_params"), `fit` and `predict`, each with
`joints` {name: readings}; `fit` with `position` (n, 3), m, too. The answer: `predicted` (n, 3), m,
`seconds`, `memory_mb`. Only Python's standard library is needed beside figaroh.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import resource
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any


def write(path: Path, rows: dict[str, Any], position: Any) -> None:
    """A file as figaroh reads it: x1, y1, z1, and the joints."""
    names = list(rows["joints"])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["x1", "y1", "z1", *names])
        readings = zip(*rows["joints"].values(), strict=True)
        writer.writerows([*p, *q] for p, q in zip(position, readings, strict=True))


def solve(job: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Fit and predict: base frame, tip and the level's parameters unknown."""
    import numpy as np
    import pinocchio as pin
    import yaml
    from figaroh.calibration.base_calibration import BaseCalibration
    from figaroh.calibration.calibration_tools import calc_updated_fkm

    fit, predict = job["fit"], job["predict"]
    write(folder / "fit.csv", fit, fit["position"])
    names = list(fit["joints"])
    calibration = {
        "enabled": True,
        "parameters": {"calibration_level": job["level"], "outlier_threshold": 0.05},
        "kinematics": {"base_frame": "universe", "tool_frame": job["tip"]},
        "measurements": {
            "markers": [
                {
                    "name": "seen",
                    "reference_joint": names[-1],
                    "measurable_dof": [True] * 3 + [False] * 3,
                }
            ],
            "poses": {"base_pose": job["base_pose"], "tool_pose": [0.0] * 6},
        },
        "data": {
            "source_file": str(folder / "fit.csv"),
            "number_of_samples": len(fit["position"]),
        },
    }
    configuration = {
        "robot": {"name": "arm", "properties": {"joints": {"active_joints": names}}},
        "tasks": {"calibration": calibration},
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(configuration), encoding="utf-8")

    class Tracked(BaseCalibration):
        """The cost that figaroh's documentation gives for positions."""

        def cost_function(self, var: Any) -> Any:
            expected = calc_updated_fkm(
                self.model, self.data, var, self.q_measured, self.calib_config
            )
            residuals = self._compute_logmap_residuals(self.PEE_measured, expected)
            return self.apply_measurement_weighting(residuals)

    robot = pin.RobotWrapper(pin.buildModelFromUrdf(job["urdf"]))  # no meshes
    began = process_time()
    found = Tracked(robot, str(folder / "config.yaml"), del_list=[])
    found.calib_config["known_baseframe"] = False
    found.calib_config["known_tipframe"] = False
    found.initialize()
    found.solve(plotting=False, enable_logging=False, html_report=False)
    seconds = process_time() - began
    count = len(next(iter(predict["joints"].values())))
    q = np.tile(pin.neutral(found.model), (count, 1))
    for name, readings in predict["joints"].items():
        q[:, found.model.joints[found.model.getJointId(name)].idx_q] = readings
    where = dict(found.calib_config, NbSample=count)
    predicted = calc_updated_fkm(found.model, found.data, found.LM_result.x, q, where)
    return {"predicted": predicted.reshape(3, -1).T.tolist(), "seconds": seconds}


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        answer = solve(job, Path(folder))
    answer["memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
