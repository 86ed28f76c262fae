"""What a phone on an arm logs: it rests at postures, and is moved in between. Simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import random_rotations

GRAVITY = 9.81
# s of a rest, of the motion after it, and between readings.
REST, MOTION, STEP = 2.0, 1.0, 0.01
# When the log began, s since 1970.
BEGIN = 1.7e9


def directions(count: int = 6, seed: int = 0) -> FloatArray:
    """(count, 3) where up is for the phone at each posture."""
    return np.asarray(random_rotations(np.random.default_rng(seed), count)[:, 2])


def log(up: FloatArray, seed: int = 1, noise: float = 0.02) -> tuple[FloatArray, FloatArray]:
    """Times (n,), s from the beginning, and what was felt (n, 3), m/s²."""
    rng, every = np.random.default_rng(seed), REST + MOTION
    time = np.arange(0.0, every * len(up) - MOTION, STEP)
    k, into = (time // every).astype(int), time % every
    share = np.clip((into - REST) / MOTION, 0.0, 1.0)[:, None]
    after = up[np.minimum(k + 1, len(up) - 1)]
    way = (1.0 - share) * up[k] + share * after
    way /= np.linalg.norm(way, axis=1)[:, None]
    felt = GRAVITY * way
    jolt = np.sin(2.0 * np.pi * into / 0.3) * (share[:, 0] > 0)
    felt += 2.0 * jolt[:, None] * np.array([0.6, 0.0, 0.8])
    return time, felt + noise * rng.standard_normal(felt.shape)


def middles(up: FloatArray) -> FloatArray:
    """(k,) s from the beginning, middle of each rest."""
    return np.asarray((REST + MOTION) * np.arange(len(up)) + 0.5 * REST)


def sensor_logger(path: Path, time: FloatArray, felt: FloatArray, metadata: str = "") -> Path:
    """As the app writes it, its metadata beside (``platform,standardisation``)."""
    lines = [
        f"{round((BEGIN + t) * 1e9)},{t:.4f},{z!r},{y!r},{x!r}"
        for t, (x, y, z) in zip(time.tolist(), felt.tolist(), strict=True)
    ]
    path.write_text("\n".join(["time,seconds_elapsed,z,y,x", *lines]) + "\n")
    if metadata:
        head = "version,device name,platform,sensors,standardisation"
        platform, standard = metadata.split(",")
        row = f'3,phone,{platform},"Accelerometer|Gravity",{standard}'
        path.with_name("Metadata.csv").write_text(f"{head}\n{row}\n")
    return path


def phyphox(
    path: Path,
    time: FloatArray,
    felt: FloatArray,
    separator: str = ",",
    decimal: str = ".",
    name: str = "Acceleration",
) -> Path:
    """As the app exports it."""
    head = ['"Time (s)"', *(f'"{name} {axis} (m/s^2)"' for axis in "xyz")]
    head.append('"Absolute acceleration (m/s^2)"')
    size = np.linalg.norm(felt, axis=1)
    rows = np.column_stack([time, felt, size]).tolist()
    lines = [separator.join(f"{v:.9E}".replace(".", decimal) for v in row) for row in rows]
    path.write_text("\n".join([separator.join(head), *lines]) + "\n")
    return path


def postures(path: Path, count: int, time: FloatArray | None = None) -> tuple[Path, FloatArray]:
    """A list of joint readings (count, 2), rad, and the file, with their times."""
    q = np.random.default_rng(7).uniform(-1.0, 1.0, (count, 2))
    columns = {"joint_1": q[:, 0], "joint_2": q[:, 1]}
    if time is not None:
        columns = {"time": time, **columns}
    rows = [",".join(map(repr, row)) for row in np.column_stack([*columns.values()]).tolist()]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path, q
