"""One pose of the tip, as it is published."""

from __future__ import annotations

from dataclasses import dataclass

from suta_calib.arrays import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class TrackedPose:
    """``T_base_tip`` of one reading; with a tool, the position is that of the tool's tip.

    Attributes:
        sequence: the reading's number, unwrapped: gaps are frames that were lost.
        time: s, of the device's clock.
        arrival: s, `time.perf_counter` when the frame's last byte was read.
        host_time: s since 1970, UTC, of the same moment.
        angles: (joints,) readings in the order of the arm's joints, rad.
        rotation: (3, 3), NaN where the pose is not valid.
        position: (3,) m, likewise.
        quaternion: (4,) x y z w with w ≥ 0, likewise.
        std: (3,) standard uncertainty of the position along the base's axes, m; None where no
            calibration's covariance is known.
        errors: joints whose encoder says that its position is invalid: there is no pose then.
        warnings: joints whose encoder warns; their pose is valid.
    """

    sequence: int
    time: float
    arrival: float
    host_time: float
    angles: FloatArray
    rotation: FloatArray
    position: FloatArray
    quaternion: FloatArray
    std: FloatArray | None
    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether every encoder of the arm vouches for its position."""
        return not self.errors
