"""Chooses the poses of a result to write, with the user's names of their frames."""

from __future__ import annotations

from typing import Final

from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result, Transform
from suta_calib.words import listed

FRAME: Final = Option(
    "frame",
    "Your name for a frame; may be repeated. Only poses between named frames are written.",
    "hand=tool0",
    several=True,
)
POSE: Final = Option("pose", "Child frame of the pose to write, if there are several.", "NAME")
POSE_OPTIONS: Final = (FRAME, POSE)


def chosen_poses(result: Result, form: str, given: Given) -> tuple[Transform, ...]:
    """The poses that are asked for, their frames by the names that are given.

    Args:
        result: with at least one pose.
        form: name of the format, for messages.
        given: `POSE_OPTIONS`.

    Raises:
        InputError: no poses, a frame or a pose that there is none of, or names for frames between
            which there is no pose.
    """
    poses, names = result.need_transforms(form), given.pairs(FRAME)
    frames = [*dict.fromkeys(frame for pose in poses for frame in (pose.parent, pose.child))]
    for name in names:
        if name not in frames:
            raise given.refuse(FRAME, f"the frame {name!r}", f"one of {listed(frames)}")
    if POSE in given:
        child = given.text(POSE)
        chosen = [pose for pose in poses if child in (pose.child, names.get(pose.child))]
        if not chosen:
            expected = f"one of {listed([pose.child for pose in poses])}"
            raise given.refuse(POSE, f"the pose {child!r}", expected)
    elif names:
        chosen = [pose for pose in poses if {pose.parent, pose.child} <= names.keys()]
        if not chosen:
            pairs = listed([f"{pose.parent} and {pose.child}" for pose in poses])
            problem = f"names for only {listed(list(names))}"
            raise given.refuse(FRAME, problem, f"names for both frames of a pose: {pairs}")
    else:
        chosen = [*poses]
    return tuple(
        Transform(names.get(p.parent, p.parent), names.get(p.child, p.child), p.matrix)
        for p in chosen
    )
