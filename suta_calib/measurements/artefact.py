"""The artefact: a rigid body with landmarks whose places in it are known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import ArtefactError, did_you_mean
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements.fields import (
    LENGTH_OR_0,
    RPY_DEG,
    TEXT,
    XYZ_MM,
    Field,
    Fields,
    Value,
    choice,
    fields_of,
    keyed,
    read_as,
)
from suta_calib.measurements.files import write_text
from suta_calib.measurements.samples import finite, rotation_matrix
from suta_calib.measurements.scale import BODY_KEYS, LengthScale, read_stretch, scale_row
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.measurements.yaml_text import rounded, yaml_text
from suta_calib.units import deg, from_mm, mm


@dataclass(frozen=True, eq=False)
class Landmark(Displayable):
    """One place of the artefact that the tip can be brought to.

    Attributes:
        name: as in the samples' column ``landmark``.
        position: (3,) in the artefact's frame, m.
        rotation: (3, 3) orientation of the tip frame in the artefact when seated, or None.
        sigma: standard deviation of each coordinate of the position, m; 0 where not stated.
    """

    name: str
    position: FloatArray = keyed(
        XYZ_MM, "Position of the tip's origin when it is seated there, in the artefact's frame."
    )
    rotation: FloatArray | None = keyed(
        RPY_DEG,
        "Orientation of the seated tip's frame in the artefact, as in a URDF; without it, only "
        "positions are used.",
        None,
        "rotation_rpy_deg",
    )
    sigma: float = keyed(LENGTH_OR_0, "Standard deviation of each coordinate; default 0.", 0.0)

    def __post_init__(self) -> None:
        where = f"landmark {self.name}"
        object.__setattr__(self, "position", finite(f"{where}: position", self.position, (3,)))
        if self.rotation is not None:
            rotation = rotation_matrix(f"{where}: rotation", self.rotation)
            object.__setattr__(self, "rotation", rotation)


@dataclass(frozen=True, eq=False, repr=False)
class Artefact:
    """A named set of landmarks.

    Attributes:
        name: of the artefact.
        landmarks: by name; a sequence of them is given their own names.
        scale: how well its common scale is known, where its file says so; see `length_scale`.
        stretch: standard deviation of how much longer it is along x and along y, as a ratio; None
            where it is as its file says, up to the scale. Then terms estimate both.
        twist: which way the plug is turned until it stops, seen against the artefact's z axis:
            ``ccw``, ``cw``, or None where its file says nothing of it.

    Raises:
        ArtefactError: no landmarks, or two of them in the same place.
    """

    name: str
    landmarks: Mapping[str, Landmark]
    scale: LengthScale | None = None
    stretch: float | None = None
    twist: str | None = None

    def __post_init__(self) -> None:
        where = f"artefact {self.name!r}"
        if not isinstance(self.landmarks, Mapping):
            marks = [*self.landmarks]
            if not all(isinstance(mark, Landmark) for mark in marks):
                raise ArtefactError(repr(marks[0]), "landmarks", where=where)
            object.__setattr__(self, "landmarks", {mark.name: mark for mark in marks})
        if not self.landmarks:
            raise ArtefactError("no landmarks", "at least one", where=where)
        if pair := coincident_landmarks(self.landmarks.values()):
            raise ArtefactError(
                f"{pair[0]!r} and {pair[1]!r} at the same place", "different places"
            )

    def __repr__(self) -> str:
        return f"<Artefact: {self.name}, {len(self.landmarks)} landmarks>"

    @property
    def length_scale(self) -> LengthScale:
        """How well its common scale is known.

        Where nobody says so: certified if any landmark has a standard deviation, for then somebody
        measured it; else machined, for then its numbers are those of a drawing.
        """
        if self.scale is not None:
            return self.scale
        certified = any(mark.sigma for mark in self.landmarks.values())
        return LengthScale.of_grade("certified" if certified else "machined")

    def landmark(self, name: str) -> Landmark:
        """The landmark of this name.

        Raises:
            ArtefactError: there is none; names the closest.
        """
        if name in self.landmarks:
            return self.landmarks[name]
        raise ArtefactError(
            f"no landmark {name!r}",
            f"one of {', '.join(self.landmarks)}",
            where=f"artefact {self.name!r}",
            hint=did_you_mean(name, self.landmarks),
        )

    def stretched(self, factors: ArrayLike) -> Artefact:
        """The artefact with its landmarks' coordinates times factors (3,) along its axes."""
        along = np.asarray(factors, dtype=float)
        marks = {n: replace(m, position=m.position * along) for n, m in self.landmarks.items()}
        return replace(self, landmarks=marks)

    def position_of(self, names: Iterable[str]) -> FloatArray:
        """Positions of landmarks by name, (n, 3) in the artefact's frame, m.

        Raises:
            ArtefactError: a name that is not in the artefact.
        """
        listed = [str(name) for name in names]
        positions = {name: self.landmark(name).position for name in dict.fromkeys(listed)}
        return np.array([positions[name] for name in listed]).reshape(-1, 3)


ARTEFACT_KEYS: Final = Fields(
    Field("name", TEXT, "Name of the artefact; default: the name of the file."),
    *BODY_KEYS,
    Field(
        "measured_mm",
        Value("x, y", lambda section, key: from_mm(np.array(section.numbers(key, 2)))),
        "Distance between the outer landmarks along x, and along y, as measured with a ruler: all "
        "positions become longer or shorter accordingly. The ruler is taken to be good to 0.2 mm "
        "unless scale_ppm is stated.",
        given_attribute="measured",
    ),
    Field(
        "twist",
        choice(("ccw", "cw"), "ccw or cw"),
        "Direction in which the plug is turned in its socket until it stops, seen from above "
        "(against the artefact's z axis). The command measure asks for this turn and checks it.",
    ),
    Field(
        "landmarks",
        Value("by name", inside=fields_of(Landmark)),
        "The places that the tip can touch, with the names in the samples' column landmark.",
        required=True,
    ),
)


def coincident_landmarks(landmarks: Iterable[Landmark]) -> tuple[str, str] | None:
    """Names of two landmarks less than 1 µm apart, in the order given; None if all are distinct."""
    listed = list(landmarks)
    position = np.array([landmark.position for landmark in listed])
    distances = np.linalg.norm(position[:, None] - position, axis=2)
    # A distance of zero has no gradient, and no artefact is made or certified this fine.
    for first, second in np.argwhere(np.triu(distances <= 1e-6, k=1))[:1]:
        return listed[first].name, listed[second].name
    return None


@checked
def read_artefact(path: str | Path) -> Artefact:
    """Read ``artefact.yaml``.

    Raises:
        ArtefactError: unreadable, an unknown, missing or unusable key (with its line), no
            landmarks, one landmark twice, two in the same place, or all so close together that
            they must be in metres.
    """
    path = Path(path)
    top = YamlSection(read_yaml(path, ArtefactError), ArtefactError)
    values = ARTEFACT_KEYS.read(top)
    listed = top.section("landmarks")
    landmarks = {key.strip(): _landmark(key.strip(), listed.section(key)) for key in listed.data}
    if "" in landmarks or len(landmarks) < len(listed.data):
        raise listed.refuse("an empty or repeated name", "each landmark's name only once")
    if pair := coincident_landmarks(landmarks.values()):
        raise listed.refuse(
            f"the same position as that of {pair[0]!r}",
            "landmarks in different places",
            at=(pair[1], "position_mm"),
        )
    span = float(np.ptp([landmark.position for landmark in landmarks.values()], axis=0).max())
    # An artefact spans more: its file must be in metres.
    if len(landmarks) > 1 and span < 1e-3:
        raise listed.refuse(
            f"all landmarks within {mm(span):.3g} mm of one another",
            "positions in mm; these look like metres",
        )
    measured = values.pop("measured", None)
    if measured is not None:
        factors, ruler = _measured(top, landmarks, measured)
        scale = values.get("scale")
        if "scale_ppm" not in top:
            values["scale"] = LengthScale(ruler, "" if scale is None else scale.grade)
    stretch = read_stretch(top, values.get("scale"))
    artefact = Artefact(**{"name": path.stem, **values}, landmarks=landmarks, stretch=stretch)
    return artefact if measured is None else artefact.stretched(factors)


def _measured(
    top: YamlSection, landmarks: Mapping[str, Landmark], measured: FloatArray
) -> tuple[FloatArray, float]:
    """Factors (3,) on coordinates, by distances (2,) with a ruler, and how sure it makes them."""
    # Of a steel ruler that is read by eye, m; and by how much the worst printers are off.
    ruler, most = from_mm(0.2), 0.1
    extents = np.ptp([landmark.position for landmark in landmarks.values()], axis=0)[:2]
    wanted = " and ".join(f"{mm(extent):g}" for extent in extents)
    expected = f"the outer landmarks' distances along x and y, about {wanted} mm"
    if not (extents > 0).all() or (np.abs(measured / extents - 1) > most).any():
        found = ", ".join(f"{mm(length):g}" for length in measured)
        raise top.refuse(f"[{found}]", expected, at=("measured_mm",))
    return np.append(measured / extents, 1.0), float(ruler / extents.min())


def _landmark(name: str, section: YamlSection) -> Landmark:
    if "position" in section:
        raise section.refuse("a position without its unit", "position_mm", at=("position",))
    landmark = read_as(Landmark, section, name=name)
    for array in (landmark.rotation, landmark.position):
        if array is not None:
            array.setflags(write=False)
    return landmark


def write_artefact(path: Path, artefact: Artefact) -> None:
    """Write ``artefact.yaml``: `artefact_text`.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    write_text(path, artefact_text(artefact))


def artefact_text(artefact: Artefact) -> str:
    """Content of ``artefact.yaml``: millimetres to 1 pm, degrees to 1e-9."""
    landmarks: dict[str, Any] = {}
    for name, landmark in artefact.landmarks.items():
        row: dict[str, Any] = {"position_mm": mm(landmark.position).tolist()}
        if landmark.rotation is not None:
            row["rotation_rpy_deg"] = deg(rpy_from_rotation(landmark.rotation)).tolist()
        if landmark.sigma:
            row["sigma_mm"] = mm(landmark.sigma)
        landmarks[name] = row
    twist = {} if artefact.twist is None else {"twist": artefact.twist}
    scale = scale_row(artefact.scale, artefact.stretch)
    return yaml_text(rounded({"name": artefact.name, **scale, **twist, "landmarks": landmarks}))
