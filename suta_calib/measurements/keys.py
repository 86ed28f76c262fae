"""The keys of a file, each said once: what a reader checks is what the reference shows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from suta_calib.measurements.yaml_file import YamlSection


@dataclass(frozen=True)
class Key:
    """One key of a mapping.

    Attributes:
        name: as it stands in the file.
        takes: what its value is, such as ``file``, ``mm`` or ``rows``.
        about: what it says, and what holds without it.
        required: whether it must be there.
        inside: of the mapping, or of every row or named mapping, that is its value.
    """

    name: str
    takes: str
    about: str
    required: bool = False
    inside: Keys | None = None


class Keys:
    """The keys that one mapping of a file may have.

    Args:
        keys: each name once, in the order in which they are shown; a function stands for those
            that take long to find out, and is asked when they are needed.
    """

    def __init__(self, *keys: Key | Callable[[], Iterable[Key]]) -> None:
        self._given: Final = keys

    def __iter__(self) -> Iterator[Key]:
        return iter(self._keys)

    @cached_property
    def _keys(self) -> tuple[Key, ...]:
        found = ((each,) if isinstance(each, Key) else each() for each in self._given)
        return tuple(chain.from_iterable(found))

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(key.name for key in self)

    @property
    def required(self) -> tuple[str, ...]:
        """Names of those that must be there."""
        return tuple(key.name for key in self if key.required)

    def check(self, section: YamlSection) -> None:
        """Refuse any other key in a mapping, and the absence of those that must be there.

        Raises:
            InputError: names the line and the key.
        """
        section.check_keys(self.names, self.required)


# What several files say in the same way.
URDF: Final = Key("urdf", "file", "The arm's URDF.", required=True)
TIP: Final = Key("tip", "text", "Link or frame whose pose matters.", required=True)
BASE: Final = Key("base", "text", "Link the chain starts from; the URDF's root link without it.")
POSITION: Final = Key("position_mm", "x, y, z in mm", "Where its origin is.", required=True)
ROTATION: Final = Key(
    "rotation_rpy_deg",
    "roll, pitch, yaw in deg",
    "How it is turned, as in a URDF; not at all without it.",
)
POSE: Final = Keys(POSITION, ROTATION)
# Numbers by grade: `measurements.scale`.
SCALE_KEYS: Final = Keys(
    Key(
        "grade",
        "certified, machined or printed",
        "How it was made. This sets the standard deviation of the scale factor of all its "
        "lengths: 20, 200 or 5,000 ppm.",
    ),
    Key(
        "scale_ppm",
        "ppm",
        "Standard deviation of the scale factor of all its lengths, in place of that of the "
        "grade; 0 for lengths that are exact by definition.",
    ),
)
STRETCH: Final = Key(
    "stretch",
    "free or fixed",
    "free: its stretch along x and along y is estimated. The prior is the standard deviation of "
    "its scale (5,000 ppm without grade and scale_ppm). The default is free for the grade "
    "printed, else fixed.",
)
