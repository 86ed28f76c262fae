"""MuJoCo's MJCF as a URDF, through Pinocchio's reader."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from lxml import etree

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_bounded
from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import Reader
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.words import listed

# What Pinocchio calls joints of one axis that turn, and that slide.
_TURN: Final = ("JointModelR", "JointModelH")
_SLIDE: Final = "JointModelP"
# URDF asks for limits of a slide, m.
_FAR: Final = 10.0
_WORLD: Final = "world"
# Characters of a name that a message shows.
_LONGEST: Final = 80


class MjcfReader(Reader):
    """Bodies, joints of one axis and sites: the kinematics, without shapes and masses."""

    name: ClassVar[str] = "mjcf"
    summary: ClassVar[str] = "MuJoCo model (MJCF), bodies with at most one joint each: a URDF"
    example: ClassVar[str] = "arm.xml --format mjcf --out arm.urdf"
    suffixes: ClassVar[tuple[str, ...]] = (".xml", ".mjcf")

    def recognises(self, path: Path, head: str) -> bool:
        """Its root element."""
        del path
        return "<mujoco" in head

    def read(self, path: Path, given: Given) -> ImportedFile:
        """A URDF with a link for each body and each site, and the joints by their names."""
        del given
        _check(path, read_bounded(path))
        import pinocchio as pin

        if not hasattr(pin, "buildModelFromMJCF"):
            found = f"Pinocchio {pin.__version__}, which reads no MJCF"
            raise ForeignFileError(found, "3.0 or newer: pip install 'pin>=3'", file=path)
        try:
            model = pin.buildModelFromMJCF(str(path))
        except (ValueError, RuntimeError, IndexError) as problem:
            said = " ".join(str(problem).split())[:160]
            expected = "a model that Pinocchio can load"
            raise ForeignFileError(f"a model it refuses ({said})", expected, file=path) from None
        text = "\n".join(_urdf(path, model, pin))
        slides = [n for n, j in zip(model.names, model.joints, strict=True) if _slides(j)]
        note = f"The limits of {listed(slides)} are not the model's: ±{_FAR:g} m."
        return ImportedFile(
            source=path,
            form=self.name,
            content=text + "\n",
            what=f"a URDF of {model.njoints - 1} joints",
            kind=".urdf",
            notes=(note,) if slides else (),
        )


def _check(path: Path, data: bytes) -> None:
    """Refuse what is no MJCF, or has entities, which Pinocchio's reader would expand."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ForeignFileError("a document type or an entity", "a plain MJCF file", file=path)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        said = f"text that is not XML ({' '.join(problem.msg.split())})"
        line = problem.lineno or None
        raise ForeignFileError(said, "an MJCF file", file=path, line=line) from None
    if root.tag != "mujoco":
        found = f"the root element <{str(root.tag)[:40]}>"
        raise ForeignFileError(found, "<mujoco>", file=path, line=root.sourceline)


def _slides(joint: Any) -> bool:
    return bool(joint.shortname().startswith(_SLIDE)) and joint.nv == 1


def _urdf(path: Path, model: Any, pin: Any) -> Iterator[str]:
    """The lines of a URDF.

    A link stands where its joint does; a body or a site that stands elsewhere is fixed to it.
    """
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    frames = [frame for frame in model.frames if frame.type in kinds]
    link = {0: _WORLD}
    for frame in frames:
        joint = frame.parentJoint
        if joint and joint not in link and frame.placement.isIdentity():
            link[joint] = frame.name
    names = [link.setdefault(k, f"{model.names[k]}_link") for k in range(model.njoints)]
    names += [frame.name for frame in frames if frame.name not in names]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ForeignFileError(f"the body {twice[:_LONGEST]!r} twice", "each name once", file=path)
    yield f'<?xml version="1.0" encoding="utf-8"?>\n<robot name={quoteattr(model.name or "arm")}>'
    yield from (f"  <link name={quoteattr(name)}/>" for name in names)
    data, neutral = model.createData(), pin.neutral(model)
    for k in range(1, model.njoints):
        joint = model.joints[k]
        kind = joint.shortname()
        if joint.nv != 1 or not kind.startswith((*_TURN, _SLIDE)):
            raise ForeignFileError(
                f"the joint {model.names[k][:_LONGEST]!r} ({kind.removeprefix('JointModel')})",
                "joints of one axis, one in each body",
                file=path,
            )
        jacobian = pin.computeJointJacobian(model, data, neutral, k)
        subspace = jacobian.reshape(6, model.nv)[:, joint.idx_v]
        axis = subspace[:3] + subspace[3:]
        lower, upper = -_FAR, _FAR
        limited = False
        if not _slides(joint) and joint.nq == 1:
            lower, upper = (
                float(limits[joint.idx_q])
                for limits in (model.lowerPositionLimit, model.upperPositionLimit)
            )
            limited = math.isfinite(upper - lower) and abs(upper - lower) > 0
        motion = "prismatic" if _slides(joint) else "revolute" if limited else "continuous"
        limits = (lower, upper) if motion != "continuous" else None
        parent, child = link[model.parents[k]], link[k]
        yield _joint(model.names[k], motion, parent, child, model.jointPlacements[k], axis, limits)
    for frame in frames:
        if frame.name not in link.values():
            parent, name = link[frame.parentJoint], f"{frame.name}_fixed"
            yield _joint(name, "fixed", parent, frame.name, frame.placement)
    yield "</robot>"


def _joint(
    name: str,
    motion: str,
    parent: str,
    child: str,
    placement: Any,
    axis: FloatArray | None = None,
    limits: tuple[float, float] | None = None,
) -> str:
    xyz, rpy, along = (
        " ".join(repr(float(value)) for value in numbers)
        for numbers in (
            placement.translation,
            rpy_from_rotation(placement.rotation),
            np.zeros(0) if axis is None else axis,
        )
    )
    lines = [
        f"  <joint name={quoteattr(name)} type={quoteattr(motion)}>",
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
        *([f'    <axis xyz="{along}"/>'] if along else []),
    ]
    if limits is not None:
        lower, upper = limits
        lines.append(f'    <limit lower="{lower!r}" upper="{upper!r}" effort="0" velocity="1"/>')
    return "\n".join([*lines, "  </joint>"])
