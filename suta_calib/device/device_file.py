"""``device.yaml``: which port, which format, which joints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import yaml

from suta_calib.device.description import (
    COUNTS_PER_TURN,
    FRAME_COUNTS_PER_TURN,
    UNASKED,
    UNITS,
    DeviceSpec,
    JointSpec,
)
from suta_calib.device.formats import FORMATS, Format
from suta_calib.device.port import expected_name
from suta_calib.errors import DeviceFileError
from suta_calib.measurements.fields import (
    TEXT,
    TEXTS,
    Field,
    Fields,
    Value,
    choice,
    fields_of,
    read_as,
    whole_number,
)
from suta_calib.measurements.samples import STROKE
from suta_calib.measurements.yaml_file import YamlSection, read_yaml, shown
from suta_calib.measurements.yaml_text import yaml_text

_DEFAULT_BAUDRATE: Final = 921600
DEVICE_KEYS: Final = Fields(
    Field(
        "port",
        TEXT,
        "Name of a port (/dev/ttyACM0, COM3, a pseudo-terminal or a link to one), or a URL: "
        "socket://host:port, rfc2217://host:port, hwgrep://2341:0043 (the port whose USB number, "
        "serial number or name contains this text), loop://. A relative name is looked up next "
        "to this file first.",
        required=True,
    ),
    Field(
        "baudrate",
        whole_number(1),
        f"Bits per second; default {_DEFAULT_BAUDRATE}, or 1000000 for servos.",
    ),
    Field(
        "format",
        choice(FORMATS),
        "What the device sends: frames (binary, with checksums; the default) or lines (one line "
        "of numbers per sample). For servos on a bus, which are polled: dynamixel (protocol 2.0, "
        'X series) or feetech (STS and SMS); these need the extra "servo".',
    ),
    Field(
        "unit",
        choice(UNITS),
        "Unit of the numbers in lines: counts, rad or deg; all other formats are in counts.",
    ),
    Field(
        "counts_per_turn",
        COUNTS_PER_TURN,
        f"Counts per turn of a joint; default {FRAME_COUNTS_PER_TURN} for frames and 4096 for "
        "servos; required for lines in counts.",
    ),
    Field(
        "joints",
        Value("rows", inside=fields_of(JointSpec)),
        "The joints, in the order in which the device sends them.",
        required=True,
    ),
    Field(
        "extra_columns",
        TEXTS,
        "Names of further numbers that lines contain after those of the joints, such as [ax, ay, "
        "az] of an accelerometer. measure averages them at each rest, and writes them beside the "
        "joints.",
    ),
)
# Columns of a recording, and of a samples file, that say when and which.
_TAKEN: Final = ("sequence", "time", "arrival", "errors", "repeat", STROKE)


def read_device(path: str | Path) -> DeviceSpec:
    """Read ``device.yaml``.

    A relative port (``emulated``, a link that an emulator made) is meant from the file's folder
    if there is something of that name, and passed to pyserial as it stands otherwise.

    Raises:
        DeviceFileError: unreadable, an unknown, missing or unusable key (with its line), one
            joint or column twice, or counts that do not fit the format.
    """
    path = Path(path)
    top = YamlSection(read_yaml(path, DeviceFileError), DeviceFileError)
    values = DEVICE_KEYS.read(top)
    form = FORMATS[values.get("format", "frames")]
    unit = values.get("unit", form.units[0])
    if form.counts_per_turn is None and unit == "counts" and "counts_per_turn" not in top:
        # Nobody's laboratory arm has 22 bits by default: lines in counts must say how many.
        raise top.refuse(
            "no such key",
            f"the number of counts per turn, because the format is {form.name} in counts",
            at=("counts_per_turn",),
        )
    counts = values.get("counts_per_turn", form.counts_per_turn or FRAME_COUNTS_PER_TURN)
    if (refused := form.refusal(unit, counts)) is not None:
        key, expected = refused
        value = {"unit": repr(unit), "counts_per_turn": str(counts)}[key]
        raise top.refuse(value, expected, at=(key,))
    port = values["port"]
    longest = 1000  # more than the name of any port; a message has to show it
    if len(port) > longest:
        raise top.refuse(shown(port), f"at most {longest} characters", at=("port",))
    if (port_form := expected_name(port)) is not None:
        raise top.refuse(repr(port), port_form, at=("port",))
    joints = _joints(top, form, unit)
    return DeviceSpec(
        path=path,
        port=_beside(top.document.path, port),
        baudrate=values.get("baudrate", form.baudrate),
        format=form.name,
        unit=unit,
        counts_per_turn=counts,
        joints=joints,
        extra_columns=_extra_columns(top, form, [joint.name for joint in joints]),
    )


def device_text(device: DeviceSpec, comment: str) -> str:
    """``device.yaml`` of a device, with a comment above it."""
    joints, unstated = list[dict[str, Any]](), JointSpec("")
    for joint in device.joints:
        # Signs always stand there, to be seen and changed.
        keys: dict[str, Any] = {"name": joint.name, "id": joint.number, "sign": joint.sign}
        for key in ("zero", "ratio", "counts_per_turn"):
            number = getattr(joint, key)
            if number != getattr(unstated, key):
                keys[key] = int(number) if number == int(number) else number
        joints.append({key: of for key, of in keys.items() if of is not None})
    document: dict[str, Any] = {
        "port": device.port,
        "baudrate": device.baudrate,
        "format": device.format,
        "unit": device.unit,
        "counts_per_turn": device.counts_per_turn,
        "joints": joints,
    }
    if device.extra_columns:
        document["extra_columns"] = list(device.extra_columns)
    return yaml_text(document, comment)


def glance(path: Path) -> DeviceSpec | None:
    """Port and baud rate of a ``device.yaml``, to open it while everything loads that checks it.

    A device without joints; None where `read_device` has anything to complain of.
    """
    try:
        # Its nodes only: what aliases make of a file is nobody's business here.
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
        given = {key.value: (node.tag.rpartition(":")[2], node.value) for key, node in root.value}
        kind, port = given["port"]
        number, baud = given.get("baudrate", ("int", _DEFAULT_BAUDRATE))
        if given.get("format", ("str", UNASKED[0]))[1] not in UNASKED:
            return None
        baudrate = int(baud)
    except Exception:  # noqa: BLE001 (whatever it is, it is told later)
        return None
    if (kind, number) != ("str", "int") or baudrate < 1:
        return None
    port = _beside(path, port)
    return DeviceSpec(path, port, baudrate, "frames", "counts", FRAME_COUNTS_PER_TURN, ())


def _beside(path: Path, port: str) -> str:
    """A relative port is meant from the file's folder if there is something of that name."""
    beside = path.parent / port
    url = re.match(r"[a-z][a-z0-9+.-]*://", port, re.IGNORECASE)
    return str(beside) if not url and not Path(port).is_absolute() and beside.exists() else port


def _joints(top: YamlSection, form: Format, unit: str) -> tuple[JointSpec, ...]:
    most_servos, sections = 253, top.sections("joints")
    if form.most_joints is not None and len(sections) > form.most_joints:
        raise top.refuse(f"{len(sections)} joints", f"at most {form.most_joints}", at=("joints",))
    joints: list[JointSpec] = []
    for section in sections:
        joint = read_as(JointSpec, section)
        if joint.name in (before.name for before in joints):
            raise section.refuse(f"{joint.name!r} twice", "each joint only once", at=("name",))
        for key in ("ratio", "counts_per_turn"):
            if key in section and not form.geared:
                expected = f"this key left out: the words of {form.name} are one turn of the joint"
                raise section.refuse("a value", expected, at=(key,))
        if unit == "counts" and joint.zero != round(joint.zero):
            raise section.refuse(f"{joint.zero:g}", "a whole number of counts", at=("zero",))
        if joint.ratio == 0.0:
            raise section.refuse("0", "turns of the encoder per turn of the joint", at=("ratio",))
        if joint.number is not None and not form.asked:
            expected = f"this key left out: joints of {form.name} are not polled by number"
            raise section.refuse(str(joint.number), expected, at=("id",))
        if form.asked:
            place = len(joints) + 1 if joint.number is None else joint.number
            if place >= most_servos or place in (before.number for before in joints):
                expected = f"a number below {most_servos}, different for each servo"
                raise section.refuse(str(place), expected, at=("id",))
            joint = replace(joint, number=place)
        joints.append(joint)
    return tuple(joints)


def _extra_columns(top: YamlSection, form: Format, joints: Sequence[str]) -> tuple[str, ...]:
    names = top.texts("extra_columns") if "extra_columns" in top else ()
    if names and not form.extra_columns:
        carrying = " or ".join(name for name, other in FORMATS.items() if other.extra_columns)
        expected = f"this key left out, or format: {carrying}. {form.name} contain joints only"
        raise top.refuse(", ".join(names), expected, at=("extra_columns",))
    for k, name in enumerate(names):
        if name in names[:k] or name in joints or name in _TAKEN:
            what = "as a joint" if name in joints else "twice"
            problem = repr(name) if name in _TAKEN else f"{name!r} {what}"
            expected = f"names of their own, and none of {', '.join(_TAKEN)}"
            raise top.refuse(problem, expected, at=("extra_columns", k))
        if not name.isprintable() or name.strip() != name or "," in name:
            expected = "a column's name without commas or blanks around it"
            raise top.refuse(repr(name), expected, at=("extra_columns", k))
    return names
