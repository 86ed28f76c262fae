"""Joint readings that are in the columns of other joints."""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from suta_calib.model.arm import ArmModel
from suta_calib.trust.misreadings import Change, MisreadJoints, mapped


class JointColumns(MisreadJoints):
    """Two columns exchanged, all of them shifted by one, reversed, or sorted by their names."""

    name = "order of the joints"
    about = "Joint readings are in the columns of other joints."
    precedence = 12

    def of_joints(self, arm: ArmModel, joints: Sequence[str]) -> Iterator[tuple[str, Change]]:
        """One for each way in which columns are mixed up."""
        identity = np.eye(len(arm.joints))
        at = np.array([arm.joints.index(joint) for joint in joints], dtype=np.intp)
        for description, order in orders(joints):
            column = np.arange(len(identity))
            column[at] = at[list(order)]
            yield description, partial(mapped, identity[column], 0.0)


def orders(names: Sequence[str]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Which joint's readings each joint's column holds, in every way that columns are mixed up."""
    rows = list(range(len(names)))
    ways = list[tuple[str, list[int]]]()
    for a, b in combinations(rows, 2):
        swapped = [b if row == a else a if row == b else row for row in rows]
        ways.append((f"the columns of {names[a]} and {names[b]} are exchanged", swapped))
    for step, neighbour in ((-1, "next"), (1, "previous")):
        description = f"the joints' columns are each under the name of the {neighbour} joint"
        ways.append((description, [*rows[step:], *rows[:step]]))
    ways.append(("the joints' columns are in the opposite order", rows[::-1]))
    # As ROS lists joint states, independent of the order along the arm.
    by_name = sorted(rows, key=lambda row: names[row])
    description = "the joints' readings are in the alphabetical order of the joints' names"
    ways.append((description, by_name))
    description = (
        "the joints' names are in alphabetical order, but their readings are in the order of the "
        "arm"
    )
    ways.append((description, np.argsort(by_name).tolist()))
    listed = {tuple(rows)}
    for description, way in ways:
        if tuple(way) not in listed:
            listed.add(tuple(way))
            yield description, tuple(way)
