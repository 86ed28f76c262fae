"""A calibrated camera, in the file that ROS and OpenCV users have: ``camera.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import CameraError
from suta_calib.geometry.lens import LENSES, PLUMB_BOB, RATIONAL, Lens
from suta_calib.measurements.camera_files import camera_document, lens_of
from suta_calib.measurements.fields import TEXT, Field, Fields, Value, whole_number
from suta_calib.measurements.files import write_text
from suta_calib.measurements.samples import finite
from suta_calib.measurements.yaml_file import YamlSection, shown

_CORNERS: Final = "corners_sha256"
# Others are ignored: whoever wrote the file has some of their own.
# Along one side; no sensor has a tenth of the most.
_PIXELS: Final = replace(whole_number(2, 1_000_000), takes="px")
_MAPPING: Final = Value("mapping")
CAMERA_KEYS: Final = Fields(
    Field("image_width", _PIXELS, "Width of the pictures.", required=True, given_attribute="width"),
    Field(
        "image_height", _PIXELS, "Height of the pictures.", required=True, given_attribute="height"
    ),
    Field(
        "camera_matrix",
        _MAPPING,
        "data: fx 0 cx 0 fy cy 0 0 1 in px, row by row; the centre of the first pixel is 0, 0.",
        required=True,
    ),
    Field(
        "distortion_coefficients",
        _MAPPING,
        "data: "
        + ", or ".join(f"{' '.join(lens.distortion)} ({lens.name})" for lens in LENSES.values())
        + ".",
        required=True,
    ),
    Field(
        "distortion_model",
        Value("text"),
        "; ".join(
            f"{' or '.join(filter(None, (lens.name, *lens.also)))}: {lens.about}"
            for lens in LENSES.values()
        )
        + f". {PLUMB_BOB.name} without it, and {RATIONAL.name} for eight coefficients.",
    ),
    Field(
        "covariance",
        _MAPPING,
        "data: the covariance, row by row, of fx fy cx cy and the distortion coefficients.",
    ),
    Field(
        _CORNERS,
        TEXT,
        "Checksum of the corners.csv that the camera was calibrated with, as `detect` writes it, "
        "so that the same corners are not counted twice.",
        given_attribute="corners",
    ),
)


@dataclass(frozen=True, eq=False)
class Camera(Displayable):
    """A camera with its lens: its picture, its intrinsics, and how well they are known.

    Attributes:
        width, height: of the picture, px.
        intrinsics: (n,) fx fy cx cy (px), and the coefficients of the lens: nine for a plumb_bob.
        covariance: (n, n) of these, or None where it is not known; zero for what was held.
        corners: `Corners.digest` of the corners it was calibrated from; empty where nobody says.
        lens: which model it follows.
    """

    width: int
    height: int
    intrinsics: FloatArray
    covariance: FloatArray | None = None
    corners: str = ""
    lens: Lens = PLUMB_BOB

    def __post_init__(self) -> None:
        n = len(self.lens.names)
        for name, shape in (("intrinsics", (n,)), ("covariance", (n, n))):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, finite(f"camera: {name}", values, shape))

    @property
    def values(self) -> Mapping[str, float]:
        """The intrinsics by name."""
        return dict(zip(self.lens.names, self.intrinsics.tolist(), strict=True))

    @property
    def stds(self) -> FloatArray | None:
        """(n,) standard deviations of the intrinsics, or None."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance))

    @property
    def matrix(self) -> FloatArray:
        """(3, 3), as OpenCV has it."""
        fx, fy, cx, cy = self.intrinsics[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in its frame, m, that its lens can see."""
        return self.lens.projected(points, self.intrinsics)

    def directions(self, pixels: ArrayLike) -> FloatArray:
        """Unit vectors (..., 3) in its frame to what it sees at pixels (..., 2)."""
        return self.lens.directions(pixels, self.intrinsics)

    def undistort(self, pixels: ArrayLike) -> FloatArray:
        """Coordinates at unit depth (..., 2) of what it sees at pixels (..., 2); NaN if behind."""
        return self.lens.undistorted(pixels, self.intrinsics)

    def resized(self, factor: float) -> Camera:
        """The camera of the same pictures, so many times as large; how well it is known is not."""
        width, height = (round(factor * size) for size in (self.width, self.height))
        intrinsics = self.intrinsics.copy()
        intrinsics[:2] *= factor
        # Pixels are counted from the centre of the first one.
        intrinsics[2:4] = factor * (intrinsics[2:4] + 0.5) - 0.5
        return replace(
            self, width=width, height=height, intrinsics=intrinsics, covariance=None, corners=""
        )

    def inside(self, pixels: FloatArray) -> BoolArray:
        """(...) whether pixels (..., 2) are in the picture; the first one's centre is 0, 0."""
        size = np.array([self.width, self.height])
        return np.asarray(np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=-1))


def read_camera(path: str | Path) -> Camera:
    """Read ``camera.yaml``: of ROS, of OpenCV's ``FileStorage``, or as `write_camera` writes it.

    A ``CameraInfo`` as ``ros2 topic echo`` prints it and a camchain of kalibr (pinhole with radtan
    or equi) are read too.

    A key ``covariance`` (``data``: row by row, in the order of `Lens.names`) says how well the
    intrinsics are known. Other keys are ignored.

    Raises:
        CameraError: unreadable, a key missing or unusable (with its line), an unknown distortion
            model, or numbers that no camera has.
    """
    top = YamlSection(camera_document(Path(path)), CameraError)
    for key in CAMERA_KEYS.required:
        if key not in top:
            hint = "use a camera.yaml from camera_calibration of ROS, or from `detect --camera-out`"
            raise top.refuse("no such key", "a value: this key is required", at=(key,), hint=hint)
    lens = lens_of(top)
    values = CAMERA_KEYS.values(top)
    matrix = _matrix(top, values["width"], values["height"])
    intrinsics = np.array([*matrix, *_coefficients(top, lens)])
    covariance = _covariance(top, lens)
    return Camera(**values, intrinsics=intrinsics, covariance=covariance, lens=lens)


def _matrix(top: YamlSection, width: int, height: int) -> list[float]:
    """Focal lengths and principal point, px."""
    section = top.section("camera_matrix")
    fx, skew, cx, *zeros, one = section.numbers("data", 9)
    shear, fy, cy, *below = zeros
    if skew or shear or any(below) or one != 1.0:
        raise section.refuse(
            shown([fx, skew, cx]), "fx 0 cx 0 fy cy 0 0 1, row by row, without skew", at=("data",)
        )
    # In picture widths; other focal lengths are in mm, or another picture's.
    least, most = 0.1 * width, 1000.0 * width
    for name, focal in (("fx", fx), ("fy", fy)):
        if not least <= focal <= most:
            raise section.refuse(
                f"{name} = {focal:g} px for a picture {width} px wide",
                f"{least:g} to {most:g} px",
                at=("data",),
                hint="the focal length must be in pixels of this picture",
            )
    for name, centre, size in (("cx", cx, width), ("cy", cy, height)):
        if not 0.0 <= centre <= size:
            raise section.refuse(
                f"{name} = {centre:g} px for a picture of {width} x {height} px",
                f"a principal point in the picture: 0 to {size} px",
                at=("data",),
                hint="image_width and image_height must be those of the pictures used for the "
                "calibration",
            )
    return [fx, fy, cx, cy]


def _coefficients(top: YamlSection, lens: Lens) -> list[float]:
    """The coefficients of a lens."""
    section, names = top.section("distortion_coefficients"), lens.distortion
    listed = section.data.get("data")
    count = len(listed) if isinstance(listed, list) else len(names)
    values = section.numbers("data", count)
    # OpenCV writes up to fourteen numbers, of which the last ones are zero in most files; and k3 is
    # a later addition. A fisheye has four, neither more nor fewer.
    few = lens is not PLUMB_BOB and count < len(names)
    many = count > len(names) if lens.sees_behind else any(values[len(names) :])
    if few or many:
        other_lenses = [other for other in LENSES.values() if len(other.distortion) == count]
        hint = f"{count} coefficients are those of {other_lenses[0].called}" if other_lenses else ""
        raise section.refuse(
            f"{count} coefficients for the distortion model {lens.called}",
            f"{len(names)}: {', '.join(names)}",
            at=("data",),
            hint=f"{hint}: correct distortion_model" if hint else "",
        )
    return [*values, *[0.0] * len(names)][: len(names)]


def _covariance(top: YamlSection, lens: Lens) -> FloatArray | None:
    if "covariance" not in top:
        return None
    section = top.section("covariance")
    n = len(lens.names)
    matrix = np.array(section.numbers("data", n * n)).reshape(n, n)
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale[scale == 0.0] = 1.0
    unit = matrix / np.outer(scale, scale)
    # A negative variance of such a share of the largest is rounding.
    if not np.allclose(unit, unit.T) or np.linalg.eigvalsh((unit + unit.T) / 2)[0] < -1e-9:
        raise section.refuse(
            "a matrix that is not a covariance",
            f"{n * n} numbers, row by row, in the order {', '.join(lens.names)}",
            at=("data",),
        )
    return np.asarray((matrix + matrix.T) / 2)


def camera_text(camera: Camera) -> str:
    """Content of ``camera.yaml``, as ROS and OpenCV read it; with the covariance where known."""
    rows = [
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"camera_matrix: {matrix_text(camera.matrix)}",
        f"distortion_model: {camera.lens.name}",
        f"distortion_coefficients: {matrix_text(camera.intrinsics[None, 4:])}",
    ]
    if camera.covariance is not None:
        rows.append(f"# of {' '.join(camera.lens.names)}")
        rows.append(f"covariance: {matrix_text(camera.covariance)}")
    if camera.corners:
        rows.append(f"{_CORNERS}: {camera.corners}")
    return "\n".join(rows) + "\n"


def matrix_text(matrix: FloatArray) -> str:
    """A matrix as ROS and OpenCV have it, with the shortest digits that read back the same."""
    rows, columns = matrix.shape
    # YAML 1.1 takes an exponent with a dot only.
    texts = map(repr, matrix.ravel().tolist())
    data = [text if "." in text else text.replace("e", ".0e") for text in texts]
    return f"{{rows: {rows}, cols: {columns}, data: [{', '.join(data)}]}}"


def write_camera(path: Path, camera: Camera) -> None:
    """Write ``camera.yaml``: `camera_text`.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    write_text(path, camera_text(camera))
