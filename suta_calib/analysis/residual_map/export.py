"""A residual map as it is written: a record for JSON, a table, and Python that needs no package."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from suta_calib.analysis.residual_map.result import JointCurve, ResidualMap
from suta_calib.arrays import FloatArray

_HEAD: Final = '''\
"""{about}

Written by suta-calib residual-map. It needs nothing but Python 3; readings are in rad (m where a
joint slides), as the device gives them.

{usage}
{together}
Left-out errors of the tip: {before:.4g} mm RMS without it, {after:.4g} mm with it.
"""

import math
{imports}
'''
_BESIDE: Final = """
It was found beside parameters that no URDF holds: {beside}.
Apply these first (result.json of the calibration has them), then this: with calibrated.urdf alone
it is not right.
"""
_JOINTS: Final = '''

def correction(joint, reading):
    """What to add to the reading of a joint, and its standard deviation, rad or m."""
    if not math.isfinite(reading):
        raise ValueError(f"reading of {joint}: found {reading}, expected a finite number")
    if joint not in CURVES:
        return 0.0, 0.0
    at, values, stds = CURVES[joint]
    inside = min(max(reading, at[0]), at[-1])
    k = min(max(bisect_right(at, inside), 1), len(at) - 1)
    share = (inside - at[k - 1]) / (at[k] - at[k - 1])
    return tuple(part[k - 1] + share * (part[k] - part[k - 1]) for part in (values, stds))


def corrected_readings(readings):
    """Readings by joint's name with the corrections added."""
    return {joint: value + correction(joint, value)[0] for joint, value in readings.items()}
'''
_POSTURE: Final = '''

def _near(readings, postures):
    """How near the readings are to each posture, 1 to 0."""
    for joint in JOINTS:
        if not math.isfinite(readings[joint]):
            found = f"found {readings[joint]}, expected a finite number"
            raise ValueError(f"reading of {joint}: {found}")
    at = [readings[joint] / length for joint, length in zip(JOINTS, LENGTHS)]
    return [
        math.exp(-0.5 * sum((a - p / l) ** 2 for a, p, l in zip(at, posture, LENGTHS)))
        for posture in postures
    ]


def tip_correction(readings):
    """What to add to the position of the calibrated tip, (x, y, z), m, in the base."""
    near = _near(readings, POSTURES)
    return tuple(sum(n * w[k] for n, w in zip(near, WEIGHTS)) for k in range(3))


def std(readings):
    """Standard deviation of each coordinate of the correction, m."""
    near = _near(readings, SUPPORT)
    known = sum(a * sum(m * b for m, b in zip(row, near)) for a, row in zip(near, MATRIX))
    return UNKNOWN * math.sqrt(max(1.0 - known, 0.0))
'''


def correction_record(residual_map: ResidualMap) -> dict[str, Any] | None:
    """The correction as JSON has it, rad and m; None where there is nothing left."""
    chosen = residual_map.chosen
    if chosen is None:
        return None
    before, after = (metrics.rms for metrics in chosen.tests[0].metrics)
    offered = residual_map.arm.offered
    record: dict[str, Any] = {
        "sort": chosen.sort,
        "robot": residual_map.arm.robot,
        "tip": residual_map.arm.tip,
        "left_out_rms_m": [before, after],
        "noise_m": residual_map.noise,
        "beside": list(residual_map.beside),
        # What it was fitted after, to be told from another calibration.
        "parameters": {
            name: value
            for name, value in residual_map.values.items()
            if name in offered and value != offered[name].nominal
        },
    }
    if chosen.sort == "joints":
        return record | {"curves": [_curve_record(curve) for curve in residual_map.curves]}
    return record | _posture_record(residual_map)


def _curve_record(curve: JointCurve) -> dict[str, Any]:
    # Beyond its ends a table goes on as it ends: with nothing.
    correction = np.r_[0.0, curve.correction[1:-1], 0.0]
    return {
        "joint": curve.joint,
        "unit": curve.unit,
        "reading": _short(curve.reading),
        "correction": _short(correction),
        "std": _short(curve.std),
    }


def _posture_record(residual_map: ResidualMap) -> dict[str, Any]:
    """Mean Σ exp(-d²/2) w, variance σ² (1 - kᵀ M k), d by lengths, k to the support."""
    assert residual_map.chosen is not None
    process, q = residual_map.chosen.process, residual_map.residuals.q
    rows = process.scaled(q)
    lengths = process.length / process.width
    amplitude = float(np.exp(process.theta[0]))
    weights = np.asarray(process.regressor.alpha_) * amplitude * process.size
    chosen = _spread_out(rows / lengths)
    support = rows[chosen]
    near = np.exp(-0.5 * np.sum(((support[:, None] - support) / lengths) ** 2, axis=2))
    # The covariance of neighbours is nearly singular.
    inverse = np.linalg.inv(near + 1e-6 * np.eye(len(near)))
    _, covariance = process.regressor.predict(support, return_cov=True)
    posterior = np.asarray(covariance).reshape(len(support), len(support), -1)[:, :, 0] / amplitude
    matrix = inverse - inverse @ posterior @ inverse
    joints = [residual_map.arm.own_joints[k] for k in process.columns]
    return {
        "joints": joints,
        "units": [residual_map.arm.units[joint] for joint in joints],
        "lengths": _short(process.length),
        "postures": _short(q[:, process.columns]),
        "weights": _short(weights),
        "support": _short(q[chosen][:, process.columns]),
        "matrix": _short(matrix),
        "unknown_m": float(process.unknown * residual_map.wider),
    }


def _spread_out(rows: FloatArray) -> list[int]:
    """Rows that are far from each other: each is the farthest from those before."""
    chosen = [0]
    away = np.linalg.norm(rows - rows[0], axis=1)
    # Postures by which the standard deviation of a map over posture is written: of more the matrix
    # between them grows large, with fewer the standard deviation is too large, not too small.
    while len(chosen) < min(60, len(rows)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(rows - rows[chosen[-1]], axis=1))
    return chosen


def python_text(record: Mapping[str, Any]) -> str:
    """A Python module that corrects readings, or the tip, without this package."""
    before, after = (1e3 * rms for rms in record["left_out_rms_m"])
    # Earlier records do not say it.
    beside = [_plain(name) for name in record.get("beside", ())]
    together = _BESIDE.format(beside=", ".join(beside)) if beside else ""
    robot = _plain(record["robot"])
    if record["sort"] == "joints":
        joint = _plain(record["curves"][0]["joint"])
        about = f"What each joint of {robot} turns more than it says, after its calibration."
        usage = (
            f'    q = corrected_readings({{"{joint}": 0.1, ...}})   # then the calibrated arm\n'
            f'    plus, plus_minus = correction("{joint}", 0.1)'
        )
        curves = {c["joint"]: [c["reading"], c["correction"], c["std"]] for c in record["curves"]}
        constants = (
            "# By joint: readings in ascending order, what to add there, standard deviation.\n"
            f"CURVES = {_literal(curves)}\n"
        )
        head = _HEAD.format(
            about=about,
            usage=usage,
            together=together,
            before=before,
            after=after,
            imports="from bisect import bisect_right\n",
        )
        return head + constants + _JOINTS
    joint = _plain(record["joints"][0])
    usage = (
        f'    dx, dy, dz = tip_correction({{"{joint}": 0.1, ...}})   # m, in the base\n'
        f'    plus_minus = std({{"{joint}": 0.1, ...}})'
    )
    about = f"How far the tip of {robot} is from where its calibration puts it."
    head = _HEAD.format(
        about=about, usage=usage, together=together, before=before, after=after, imports=""
    )
    keys = ("joints", "lengths", "unknown_m", "postures", "weights", "support", "matrix")
    names = (key.removesuffix("_m").upper() for key in keys)
    lines = (f"{n} = {_literal(record[k])}\n" for n, k in zip(names, keys, strict=True))
    return head + "".join(lines) + _POSTURE


def table_text(record: Mapping[str, Any]) -> str:
    """The correction as CSV: of joints by reading, or of the tip in the measured postures."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    if record["sort"] == "joints":
        writer.writerow(["joint", "unit", "reading", "correction", "std"])
        for curve in record["curves"]:
            columns = (curve[key] for key in ("reading", "correction", "std"))
            for row in zip(*columns, strict=True):
                writer.writerow([curve["joint"], curve["unit"], *row])
        return stream.getvalue()
    postures, lengths = np.array(record["postures"]), np.array(record["lengths"])

    def near(others: FloatArray) -> FloatArray:
        square = np.sum(((postures[:, None] - others) / lengths) ** 2, axis=2)
        return np.asarray(np.exp(-0.5 * square))

    moved = near(postures) @ np.array(record["weights"])
    to_support = near(np.array(record["support"]))
    explained = np.einsum("nk,kl,nl->n", to_support, np.array(record["matrix"]), to_support)
    std = record["unknown_m"] * np.sqrt(np.maximum(1.0 - explained, 0.0))
    writer.writerow([*record["joints"], "dx", "dy", "dz", "std"])
    for row in np.hstack([postures, moved, std[:, None]]):
        writer.writerow([f"{value:.9g}" for value in row])
    return stream.getvalue()


def _plain(name: Any) -> str:
    """A name as it may stand in a docstring, whatever is in it."""
    return str(name).encode("unicode_escape").decode().replace('"', "'").replace("\\", "/")


def _literal(value: Any) -> str:
    """A value that is the same in JSON and in Python."""
    return json.dumps(value)


def _short(values: Any) -> Any:
    """Numbers as lists, with nine digits."""
    if isinstance(values, np.ndarray):
        values = values.tolist()
    if isinstance(values, list):
        return [_short(value) for value in values]
    return float(f"{values:.9g}")
