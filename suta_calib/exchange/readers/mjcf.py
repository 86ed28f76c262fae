"""MuJoCo's MJCF as a URDF, as MuJoCo itself reads it."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin
from lxml import etree

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_bounded
from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import Reader
from suta_calib.geometry.numbers import homogeneous, rotation_from_quaternion, rotation_from_vector
from suta_calib.model.urdf import joint_text, number_text
from suta_calib.optional_packages import require
from suta_calib.sandbox import ConfinedError, run_confined
from suta_calib.words import listed

_CHILD: Final = "suta_calib.exchange.mjcf_child"
_COUPLED: Final = (
    "The model has equality constraints, which couple joints or close loops. In the URDF each "
    "joint has its own reading."
)
# MuJoCo's mjtJoint.
_FREE, _BALL, _SLIDE, _HINGE = range(4)
# URDF requires limits of a slide, m.
_FAR: Final = 10.0
# Characters of a name, and of what MuJoCo says, that a message shows.
_LONGEST, _LONGEST_REASON = 80, 200


class MjcfReader(Reader):
    """Bodies, joints and sites: the kinematics, without shapes and masses."""

    name = "mjcf"
    summary = "MuJoCo model (MJCF) with bodies, joints of one axis and sites, to a URDF"
    example = "arm.xml --format mjcf --out arm.urdf"
    signature = re.compile("<mujoco")
    suffixes = (".xml", ".mjcf")
    extra = "formats"

    def read(self, path: Path, given: Given) -> ImportedFile:
        """A URDF with a link for each body and each named site, and the joints by their names.

        MuJoCo reads the file, in a process with bounded time and memory. Before it is returned, the
        URDF is held against MuJoCo's own kinematics in random postures.
        """
        del given
        _check(path, read_bounded(path))
        require("mujoco", self.extra)
        try:
            model = run_confined(_CHILD, str(path))
        except ConfinedError as problem:
            description = f"a model that takes {problem} to read"
            raise ForeignFileError(description, "a model of an arm", file=path) from None
        if "refused" in model:
            raise _refusal(path, str(model["refused"]))
        if not any(joint["kind"] in (_SLIDE, _HINGE) for joint in model["joints"]):
            description = "a model without revolute or prismatic joints"
            raise ForeignFileError(description, "an arm: bodies with joints", file=path)
        tree = _Tree(path, model)
        text = "\n".join(tree.lines()) + "\n"
        tree.compare(text)
        count = len(model["joints"])
        joints = "1 joint" if count == 1 else f"{count} joints"
        return ImportedFile(
            source=path,
            form=self.name,
            content=text,
            what=f"a URDF of {joints}, as MuJoCo {model['version']} reads it",
            kind=".urdf",
            notes=(_COUPLED,) if model["coupled"] else (),
            remarks=tuple(tree.differences()),
        )


def _check(path: Path, data: bytes) -> None:
    """Refuse what is no MJCF, or has entities, which MuJoCo would ignore."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ForeignFileError("a document type or an entity", "a plain MJCF file", file=path)
    try:
        root = _parsed(data)
    except etree.XMLSyntaxError as problem:
        description = f"text that is not XML ({' '.join(problem.msg.split())})"
        line = problem.lineno or None
        raise ForeignFileError(description, "an MJCF file", file=path, line=line) from None
    if root.tag != "mujoco":
        root_found = f"the root element <{str(root.tag)[:40]}>"
        raise ForeignFileError(root_found, "<mujoco>", file=path, line=root.sourceline)
    _check_included(path, root, path.parent, {path})


def _parsed(data: bytes) -> Any:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
    return etree.fromstring(data, parser)


def _check_included(path: Path, root: Any, folder: Path, checked: set[Path]) -> None:
    """Refuse pipes and devices in place of the files that a model includes: MuJoCo would wait."""
    for element in root.iter("include", "model"):
        target = folder / element.get("file", "")
        # What is not there MuJoCo may find elsewhere, or refuses itself.
        if not element.get("file") or target in checked or not target.exists():
            continue
        checked.add(target)
        try:
            data = read_bounded(target)
        except ForeignFileError as problem:
            raise ForeignFileError.of(problem, path, element.sourceline, str(target)) from None
        with contextlib.suppress(etree.XMLSyntaxError):
            _check_included(target, _parsed(data), folder, checked)


def _refusal(path: Path, reason: str) -> ForeignFileError:
    """What MuJoCo refuses, with its line where it can be no line of an included file."""
    at = re.search(r"line (\d+)", reason)
    single_file = b"<include" not in path.read_bytes() and b"<model" not in path.read_bytes()
    problem = f"a model that MuJoCo rejects ({reason[:_LONGEST_REASON]})"
    expected = "a file that MuJoCo loads, together with the files that it includes"
    return ForeignFileError(
        problem, expected, file=path, line=int(at[1]) if at and single_file and int(at[1]) else None
    )


class _Tree:
    """A compiled model as links and joints of a URDF."""

    def __init__(self, path: Path, model: Mapping[str, Any]) -> None:
        self.path, self.model = path, model
        self.bodies: Sequence[Any] = model["bodies"]
        self.joints: Sequence[Any] = model["joints"]
        self.sites = [site for site in model["sites"] if site["name"]]
        for joint in self.joints:
            if joint["kind"] == _BALL:
                name = repr(joint["name"][:_LONGEST])
                problem = f"the joint {name}, which turns about any axis (ball)"
                raise ForeignFileError(problem, "joints of one axis, as in URDF", file=path)
        numbers = [n for e in (*self.bodies, *self.sites) for n in (*e["pos"], *e["quat"])]
        for joint in self.joints:
            numbers += [*joint["pos"], *joint["axis"], joint["ref"], *(joint["range"] or ())]
        if not np.isfinite(numbers).all():
            raise ForeignFileError("numbers that are not finite", "a model of an arm", file=path)
        # Bodies keep their names, which are unique in MuJoCo; so do sites and joints, unless a body
        # or a site has the name already.
        self._links, self._joints = set[str](), set[str]()
        self.body_names = [
            _unique(body["name"] or f"body_{k}", self._links) for k, body in enumerate(self.bodies)
        ]
        self.site_names = [
            _unique(site["name"], self._links, f"{site['name']}_site") for site in self.sites
        ]
        self.joint_names = [
            _unique(joint["name"] or f"{self.body_names[joint['body']]}_joint", self._joints)
            for joint in self.joints
        ]

    def differences(self) -> Iterator[str]:
        """What the URDF says otherwise than the model."""
        for k, joint in enumerate(self.joints):
            if joint["kind"] == _FREE:
                name = self.body_names[joint["body"]]
                yield (
                    f"{name} floats freely ({self.joint_names[k]}); it may be the base of a chain."
                )
        far = [n for n, j in self._named() if j["kind"] == _SLIDE and j["range"] is None]
        if far:
            yield f"The model gives no limits for {listed(far)}; the URDF has ±{_FAR:g} m there."
        for name, body in zip(self.body_names, self.bodies, strict=True):
            if body["mocap"]:
                yield f"{name} is moved from outside (mocap); in the URDF it is fixed."
        for name, site in zip(self.site_names, self.sites, strict=True):
            if site["name"] != name:
                yield (
                    f"A body and a site are both called {site['name']}; the URDF calls the "
                    f"site {name}."
                )

    def _named(self) -> Iterator[tuple[str, Any]]:
        return zip(self.joint_names, self.joints, strict=True)

    def lines(self) -> Iterator[str]:
        """The lines of the URDF.

        A body whose joint is not in its origin gets a link of its own there, and one with several
        joints a link for each. MuJoCo turns a body about the joint's ``pos``, by its reading less
        its ``ref``: in URDF the turn by ``-ref`` is part of the origin.
        """
        joints = [line for k in range(1, len(self.bodies)) for line in self._body(k)]
        for site, name in zip(self.sites, self.site_names, strict=True):
            parent, pose = self.body_names[site["body"]], _pose(site)
            joints.append(
                joint_text(_unique(f"{name}_fixed", self._joints), "fixed", parent, name, pose)
            )
        yield '<?xml version="1.0" encoding="utf-8"?>'
        yield f"<robot name={quoteattr(self.model['model'] or 'arm')}>"
        in_order = (*self.body_names, *self.site_names)
        further = sorted(self._links - set(in_order))
        yield from (f"  <link name={quoteattr(name)}/>" for name in (*in_order, *further))
        yield from joints
        yield "</robot>"

    def _body(self, k: int) -> Iterator[str]:
        """The joints from a body's parent to the body."""
        body, name = self.bodies[k], self.body_names[k]
        parent, pose = self.body_names[body["parent"]], _pose(body)
        joints = [(n, joint) for n, joint in self._named() if joint["body"] == k]
        for place, (joint_name, joint) in enumerate(joints):
            if joint["kind"] == _FREE:
                x, y, z, *quat = joint["pose"]
                pose = _pose({"pos": (x, y, z), "quat": quat})
                yield joint_text(joint_name, "floating", parent, name, pose)
                return
            axis, limits = np.array(joint["axis"]), joint["range"]
            if joint["kind"] == _HINGE:
                motion = "continuous" if limits is None else "revolute"
                turned = rotation_from_vector(-joint["ref"] * axis)
                pose = pose @ homogeneous(turned, joint["pos"])
                back = homogeneous(np.eye(3), -np.array(joint["pos"]))
            else:
                motion, limits = "prismatic", limits or (-_FAR, _FAR)
                pose = pose @ homogeneous(np.eye(3), -joint["ref"] * axis)
                back = np.eye(4)
            last = place == len(joints) - 1 and np.array_equal(back, np.eye(4))
            child = name if last else _unique(f"{joint_name}_link", self._links)
            yield joint_text(
                *(joint_name, motion, parent, child, pose),
                axis=" ".join(map(number_text, axis)),
                limits=limits,
            )
            parent, pose = child, back
        if parent != name:
            yield joint_text(_unique(f"{name}_fixed", self._joints), "fixed", parent, name, pose)

    def compare(self, text: str) -> None:
        """Hold the URDF, as Pinocchio reads it, against where MuJoCo has the bodies and sites."""
        model = pin.buildModelFromXML(text)
        data = model.createData()
        names = (*self.body_names, *self.site_names)
        frames = [model.getFrameId(name, pin.FrameType.BODY) for name in names]
        named = [k for k, site in enumerate(self.model["sites"]) if site["name"]]
        # How far the URDF may be from MuJoCo's kinematics, m and as a cosine: numbers of 1e-12
        # along a long chain, and rotations as roll, pitch and yaw.
        agree = 1e-9
        for posture in self.model["postures"]:
            q = pin.neutral(model)
            for (name, joint), reading in zip(self._named(), posture["readings"], strict=True):
                if joint["kind"] not in (_SLIDE, _HINGE):
                    continue
                of = model.joints[model.getJointId(name)]
                both = (np.cos(reading), np.sin(reading)) if of.nq == 2 else (reading,)
                q[of.idx_q : of.idx_q + of.nq] = both
            pin.framesForwardKinematics(model, data, q)
            theirs = [*posture["bodies"], *(posture["sites"][k] for k in named)]
            for name, frame, numbers in zip(names, frames, theirs, strict=True):
                pose = data.oMf[frame]
                ours = np.concatenate([pose.translation, pose.rotation.ravel()])
                difference = np.abs(ours - numbers).max() / max(1.0, float(np.abs(numbers).max()))
                if not difference <= agree:
                    place = f"{name[:_LONGEST]!r} wrong by {difference:.2g} compared with the model"
                    expected = f"agreement with MuJoCo's kinematics to {agree:g}"
                    hint = "please report this file"
                    problem = f"a URDF with {place}"
                    raise ForeignFileError(problem, expected, file=self.path, hint=hint)


def _unique(name: str, taken: set[str], otherwise: str = "") -> str:
    chosen, otherwise, k = name, otherwise or name, 1
    while chosen in taken:
        chosen, k = otherwise if k == 1 else f"{otherwise}_{k}", k + 1
    taken.add(chosen)
    return chosen


def _pose(element: Mapping[str, Any]) -> FloatArray:
    w, x, y, z = element["quat"]
    return homogeneous(rotation_from_quaternion([x, y, z, w]), element["pos"])
