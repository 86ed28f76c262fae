"""Links that lean by what an accelerometer on them felt beyond the model.

With R the orientation of a link in the base as the model has it, u the direction of "up" there (as
the arm stands, leaned by ``tilt.up_rx|ry|rz``) and a what the sensor felt, a unit vector that
points up in its own frame, the sensor finds "up" in the base at

    w = R Y S a

S is how the sensor is mounted in the link (``tilt[link].mount_rx|ry|rz``): it and u are such that w
is u on average (`solver.sensor_mounts`). No average tells how a sensor is turned about the
vertical: Y turns it about the axis that is upright in the link where all readings are zero, by
``tilt[link].turn``. The link, and all that it carries, is then turned by the least rotation T that
takes w to u, about a point at ``tilt[link].share`` of the way from the link's origin to the joints
that it carries: 0 for a link that stands on something soft, about a half for one that bends all
along.

T takes back whatever the model had of the link's lean: errors of the joints below that would lean
it do not move the tip. Of the sensors on a chain each adds what those below it have left. A turn
about the vertical is felt by none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.model.parameters import SHARE, Parameter, Selection

TURN: Final = "turn"
# A rotation vector, sensor to link.
MOUNT: Final = ("mount_rx", "mount_ry", "mount_rz")
# A rotation vector, of "up" from where the arm's mounting has it: all sensors share it.
_UP_KEYS: Final = ("up_rx", "up_ry", "up_rz")
UP: Final = tuple(f"tilt.{key}" for key in _UP_KEYS)


def is_share(name: str) -> bool:
    """Whether a parameter says where a link with a sensor turns."""
    return name.startswith("tilt[") and name.endswith(f"].{SHARE}")


@dataclass(frozen=True)
class TiltSensor(Displayable):
    """An accelerometer on a link, whose readings are in the samples.

    Attributes:
        link: name of the link.
        columns: of its readings along its own x, y and z, in any one unit; at rest they point up.
            ``LINK_ax, LINK_ay, LINK_az`` where nobody says.
        rpy: how it is turned in the link, rad, as in a URDF; None where nobody says.
        upright: which way is up in the link where all readings are zero; None for as the URDF of
            the arm has it.
    """

    link: str
    columns: tuple[str, str, str] = ("", "", "")
    rpy: tuple[float, float, float] | None = None
    upright: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not any(self.columns):
            names = tuple(f"{self.link}_a{axis}" for axis in "xyz")
            object.__setattr__(self, "columns", names)

    @property
    def felt(self) -> str:
        """What its readings are called in `Samples.felt`."""
        return ",".join(self.columns)

    @property
    def owner(self) -> str:
        """Of its parameters."""
        return f"tilt[{self.link}]"

    def names(self, *keys: str) -> list[str]:
        """Of its parameters with these keys."""
        return [f"{self.owner}.{key}" for key in keys]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Where the link turns, and how the sensor is mounted."""
        # Nobody says where a sensor's axes point: anywhere about the vertical.
        any_turn = 3.2
        return (
            # One that is found to a quarter tells more than its bounds do.
            Parameter(self.owner, SHARE, "1", 0.5, lower=0.0, upper=1.0, plausible=2.5),
            Parameter(self.owner, TURN, "rad", lower=-any_turn, upper=any_turn),
            *(Parameter(self.owner, key, "rad") for key in MOUNT),
        )

    @property
    def all_parameters(self) -> tuple[Parameter, ...]:
        """With what all sensors share."""
        return (*self.parameters, *up_parameters())

    @property
    def selections(self) -> Iterator[Selection]:
        """Rows among a job's parameters: the mounting is found before, and stays."""
        turns = [TURN] if self.rpy is None else []
        yield Selection(tuple(self.names(SHARE, *turns)))
        yield Selection((*self.names(*MOUNT), *UP), fixed=True)


def up_parameters() -> tuple[Parameter, ...]:
    """Of what all sensors share."""
    return tuple(Parameter("tilt", key, "rad") for key in _UP_KEYS)


@dataclass(frozen=True, eq=False)
class TiltedLink:
    """Where a chain has a link with a sensor.

    Attributes:
        sensor: on it.
        behind: owner of the segment that leads to it; empty for the base.
        reach: (3,) from its origin to the joints that it carries, in its frame, m.
        column: where its reading begins among those of all sensors of the chain.
    """

    sensor: TiltSensor
    behind: str
    reach: FloatArray
    column: int
