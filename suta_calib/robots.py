"""Other people's arms by name: ``robots.load("ur5")``, from ``example-robot-data`` (an extra).

A robot's name is that of its URDF, without ``_robot``; where two robots' files are called alike, it
is that of their folder, without ``_description``. What the robots are, and their licences:
https://github.com/Gepetto/example-robot-data.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Final

from suta_calib.errors import InputError, UrdfError, did_you_mean
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ends
from suta_calib.model.urdf_tree import TreeJoint, UrdfTree, quoted, read_tree
from suta_calib.optional_packages import missing

_PACKAGE: Final = "example-robot-data"
_ROBOTS: Final = "cmeel.prefix/share/example-robot-data/robots"
# What the frame at an arm's end is called in many URDFs, the most usual first.
_END_NAMES: Final = ("tool0", "tool_link", "tcp", "end_effector", "gripper_frame")


def load(name: str, tip: str | None = None, base: str | None = None) -> ArmModel:
    """The arm of this name, at nominal.

    Args:
        name: one of `names`, such as ``ur5``.
        tip: link or joint, as for `ArmModel.from_urdf`; by default where the arm ends (`end_of`).
        base: likewise; the root link by default.

    Raises:
        MissingExtraError: the robots are not installed.
        InputError: no robot of this name.
        UrdfError: no default tip, because the robot is no single arm: says where its limbs end.
    """
    urdf = path(name)
    return ArmModel.from_urdf(urdf, end_of(read_tree(urdf)) if tip is None else tip, base)


def names() -> tuple[str, ...]:
    """Of all robots, in alphabetical order.

    Raises:
        MissingExtraError: the robots are not installed.
    """
    return tuple(_files())


def path(name: str) -> Path:
    """The URDF of the robot of this name.

    Raises:
        MissingExtraError: the robots are not installed.
        InputError: no robot of this name.
    """
    files = _files()
    if name not in files:
        hint = did_you_mean(name, files) or f"the names are {', '.join(files)}"
        raise InputError(quoted(name), f"a robot of {_PACKAGE}", where="robots", hint=hint)
    return files[name]


@cache
def _files() -> Mapping[str, Path]:
    """Every robot's URDF by its name."""
    try:
        folder = Path(str(distribution(_PACKAGE).locate_file(_ROBOTS)))
    except PackageNotFoundError:
        raise missing(_PACKAGE, "robots") from None
    same_stem = defaultdict[str, list[Path]](list)
    for urdf in folder.rglob("*.urdf"):
        same_stem[urdf.stem.removesuffix("_robot")].append(urdf)
    urdfs = dict[str, Path]()
    for name, files in same_stem.items():
        homes = {urdf.relative_to(folder).parts[0]: urdf for urdf in sorted(files)}
        for home, urdf in homes.items():
            urdfs[name if len(homes) == 1 else home.removesuffix("_description")] = urdf
    return dict(sorted(urdfs.items()))


def end_of(tree: UrdfTree) -> str:
    """The link where the arm of a tree ends: its flange, its tool, or the palm of its hand.

    Down from the root the way follows the branch with the most moving joints in a row. It ends at
    a fixed link that is called as such ends are, where nothing more moves at the last link that is
    fixed there, or where branches are equal, as fingers are.

    Args:
        tree: of a URDF.

    Raises:
        UrdfError: the branches there are longer than the way to them, as legs are.
    """
    below = defaultdict[str, list[TreeJoint]](list)
    for joint in tree.joints.values():
        below[joint.parent].append(joint)

    def length(joint: TreeJoint) -> tuple[int, int]:
        """Moving joints, then joints of any type, in the longest row that begins with this one."""
        moving, every = max(map(length, below[joint.child]), default=(0, 0))
        return moving + joint.moves, every + 1

    link, passed = tree.root, 0
    while branches := below[link]:
        if passed and (end := _named_end(branches)):
            return end
        longest = max(map(length, branches))
        longest_branches = [joint for joint in branches if length(joint)[0] == longest[0]]
        if longest[0] and len(longest_branches) > 1:
            if longest[0] >= passed:
                raise UrdfError(
                    f"{tree.robot}, which is no single arm",
                    "a tip",
                    file=tree.path,
                    where="tip",
                    hint=ends(tree),
                )
            break
        # Of those that are only fixed the last of the longest: a tool comes after its flange.
        taken = [joint for joint in branches if length(joint) == longest][-1]
        link, passed = taken.child, passed + taken.moves
    return link


def _named_end(branches: Iterable[TreeJoint]) -> str:
    """The link that is fixed here and called as an arm's end, or nothing."""
    fixed = [joint.child for joint in branches if not joint.moves]
    return next((link for name in _END_NAMES for link in fixed if name in link.lower()), "")
