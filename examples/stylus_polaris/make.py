"""Simulate a stylus that pivots before an NDI tracker: `python examples/stylus_polaris/make.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.measurements import write_text

FILE = Path(__file__).parent / "track.csv"
STYLUS, REFERENCE = "8700340", "8700339"
# Of the stylus, m; where the divot is in the reference; the reference in the tracker.
TIP = np.array([-0.0182, 0.0011, -0.1587])
DIVOT = np.array([0.0405, 0.0120, -0.0080])
PLACE, TURN = (
    np.array([0.11, -0.06, -1.42]),
    Rotation.from_euler("xyz", (10, -25, 40), degrees=True),
)
# Of a coordinate, m, and of the turn about an axis, rad.
NOISE, TURN_NOISE = 0.12e-3, np.radians(0.04)
FRAMES, MISSING = 120, (30, 31, 77)
COLUMNS = "ToolInfo,Frame#,PortHandle,Face#,TransformStatus,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error,#Markers"


def cells(name: str, frame: int, turn: Rotation, place: np.ndarray) -> str:
    """One tool of a frame, mm."""
    x, y, z, w = turn.as_quat()
    numbers = ",".join(f"{n:.6f}" for n in (w, x, y, z, *(1e3 * place)))
    return f"{name},{frame},01,0,OK,{numbers},0.09,4"


def main() -> None:
    """Write the frames."""
    random = np.random.default_rng(3)

    def seen(turn: Rotation, place: np.ndarray) -> tuple[Rotation, np.ndarray]:
        shaken = turn * Rotation.from_rotvec(TURN_NOISE * random.standard_normal(3))
        return shaken, place + NOISE * random.standard_normal(3)

    lines = [f"ToolCount,{COLUMNS},{COLUMNS}"]
    for frame in range(FRAMES):
        heading, lean = random.uniform(0, 2 * np.pi), np.radians(random.uniform(5, 45))
        axis = np.array([np.cos(heading), np.sin(heading), 0.0])
        stylus = TURN * Rotation.from_rotvec(lean * axis)
        stylus *= Rotation.from_euler("z", random.uniform(-60, 60), degrees=True)
        place = PLACE + TURN.apply(DIVOT) - stylus.apply(TIP)
        tool = cells(STYLUS, frame, *seen(stylus, place))
        if frame in MISSING:
            tool = f"{STYLUS},{frame},01,0,Missing{9 * ','}0"
        lines.append(f"2,{tool},{cells(REFERENCE, frame, *seen(TURN, PLACE))}")
    write_text(FILE, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
