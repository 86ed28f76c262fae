"""Report of a hand-eye calibration from pictures: cameras, intrinsics, fit of the pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import FloatArray
from suta_calib.geometry.lens import CENTRE, FOCAL
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements.camera import camera_text
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.model.parameters import PLACEMENT
from suta_calib.plotting.look import BLUE, GREY, LARGE, OUTLIER
from suta_calib.pose_calibration.eye_poses import FRAMES
from suta_calib.pose_calibration.picture_answer import ROBOTS, CameraEstimate, PictureCalibration
from suta_calib.pose_calibration.picture_models import MODELS, ErrorModel
from suta_calib.pose_calibration.picture_noise import PictureNoise
from suta_calib.report.document import Document, Figure, File, Part, Text
from suta_calib.report.hand_eye import NAME, frame_tables
from suta_calib.report.listing import Column, Json, Listing, csv_text, plain, shown_as
from suta_calib.report.many_eyes import BETWEEN
from suta_calib.report.markers import marker_parts, marker_records
from suta_calib.report.poses import (
    MOST_OUTLIERS,
    between_record,
    covariance_record,
    not_found_record,
    pose_record,
    pose_std_record,
)
from suta_calib.report.svg import picture, svg_text
from suta_calib.report.uncertainty import budget_record
from suta_calib.terms.hand_eye_start import EYE_IN_HAND
from suta_calib.units import NOTHING, Unit, deg, mm, text
from suta_calib.words import listed


def _shown(k: int) -> Callable[[tuple[Any, ...]], str]:
    """A number of an intrinsic, in its unit."""
    return lambda row: NOTHING if row[k] is None else text(row[k], row[4])


# Name, as the camera's file has it, as found, with its standard deviation, and the unit.
INTRINSIC: Final = Listing[tuple[str, float | None, float, float | None, Unit]](
    "Intrinsics",
    Column("name", "", lambda row: row[0]),
    *(shown_as(heading, _shown(k)) for k, heading in enumerate(("given", "found", "± std"), 1)),
    Column("unit", "", lambda row: row[4] if row[4] == "px" else ""),
)


def _corner(key: str, column: int, unit: Unit | None = None) -> Column[tuple[Any, FloatArray]]:
    return Column(key, value=lambda row: float(row[1][column]), unit=unit)


# Every corner in every picture of every camera.
CORNERS: Final = Listing[tuple[CameraEstimate, FloatArray]](
    "Every corner",
    Column("camera", value=lambda row: row[0].label),
    Column("image", value=lambda row: row[0].images[int(row[1][0])]),
    Column("point", value=lambda row: int(row[1][1])),
    *(_corner("u", 2), _corner("v", 3), _corner("du", 4, "px"), _corner("dv", 5, "px")),
    Column("status", value=lambda row: "inlier" if row[1][6] else "outlier"),
)


def picture_document(
    calibration: PictureCalibration, data: HandPoses, *, named: bool = False
) -> Document:
    """X of every camera, Z where the model asks for it, and intrinsics, with standard deviations.

    Files: ``residuals.csv``, ``camera.yaml`` of every camera whose intrinsics were found, and
    ``board.yaml`` of a board whose markers nobody had measured. ``named`` cameras and boards have
    X and Z by name.
    """
    several = len(calibration.cameras) + len(calibration.not_found) > 1
    # Without a camera that was given it must be clear whose X is whose.
    named = named or bool(calibration.not_found)
    parts, files = list[Part](), set[str]()
    for camera in calibration.cameras:
        if several:
            parts.append(Text(f"Camera {calibration.name_of(camera)}", look="heading"))
        parts += frame_tables(calibration, camera)
        if camera.camera.covariance is not None:
            parts.append(INTRINSIC.of(_intrinsics(camera)))
            name = f"camera-{camera.label}.yaml" if several else "camera.yaml"
            if name not in files:
                parts.append(File(name, partial(_camera_file, camera)))
            files.add(name)
        if camera.markers is not None:
            parts += marker_parts(camera.markers, camera.label if several else "")
        parts += _fit(camera)
    if calibration.between:
        title = f"The other cameras in camera {calibration.between[0].inside}"
        parts.append(BETWEEN.of(calibration.between, title))
    corners = [(camera, row) for camera in calibration.cameras for row in camera.corners]
    parts += [
        Text(sentence)
        for sentence in (_predicted(calibration), _hand(calibration.noise))
        if sentence
    ]
    optimality, digits = calibration.optimality, 6
    if optimality is not None and optimality.good:
        parts.append(Text(optimality.sentence))
    parts += [
        File("residuals.csv", lambda: csv_text(CORNERS, corners, digits)),
        Figure(partial(picture_plot, calibration)),
    ]
    first = calibration.cameras[0]
    record: Json = {
        "setup": calibration.setup,
        "model": calibration.model,
        **(_named(calibration) if named else _record(calibration, first)),
    }
    if several or named:
        usable = calibration.assessment.usable
        record["cameras"] = {
            calibration.name_of(camera): {"usable": usable, **_record(calibration, camera)}
            for camera in calibration.cameras
        } | {one.name: not_found_record(one) for one in calibration.not_found}
    if calibration.between:
        record["between_eyes"] = between_record(calibration.between)
    record["hand_noise"] = {
        "position_mm": mm(calibration.noise.position.value),
        "rotation_deg": deg(calibration.noise.rotation.value),
        "log_std": [calibration.noise.position.log_std, calibration.noise.rotation.log_std],
        "shared_position_mm": mm(calibration.noise.shared[0]),
        "shared_rotation_deg": deg(calibration.noise.shared[1]),
        "model": calibration.error_model.name,
        "share_by_pixels": calibration.error_model.share
        if calibration.error_model.base_by_pixels
        else None,
        "left_out_rms_px": {
            "hand-errors": _left_out(calibration, MODELS[0]),
            "exact-hand": _left_out(calibration, MODELS[-1]),
        },
    }
    counts = [len(camera.images) for camera in calibration.cameras]
    lost = [int((~camera.inliers).sum()) for camera in calibration.cameras]
    if optimality is not None:
        record["optimality"] = {
            "certified": False,
            "gap": None,
            "poses_certified": optimality.poses_certified,
            "poses_gap": optimality.poses_gap,
            "reached": optimality.reached,
        }
    record |= {
        "frames": {name: FRAMES[calibration.setup][name] for name in calibration.unknowns},
        "reprojection_rms_px": calibration.rms,
        "reprojection_left_out_rms_px": calibration.left_out,
        "outliers": list(calibration.outliers),
        "outlier_lines": [data.lines[row] for row in calibration.outliers],
        "counts": {
            "rows": len(data.lines),
            "images": sum(counts),
            "inliers": sum(counts) - sum(lost),
            "outliers": sum(lost),
        },
        "uncertainty": [
            budget_record(budget)
            for camera in calibration.cameras
            for budget in camera.budgets(
                f"X of {calibration.name_of(camera)}" if several or named else "X"
            )
        ],
        "input": str(data.path),
    }
    title = "Hand-eye calibration from pictures"
    return Document(NAME, title, calibration.assessment, parts, record, "result")


def _camera_file(camera: CameraEstimate) -> str:
    """``camera.yaml``, which says where the size of the pictures is not known."""
    least = (
        "# image_width and image_height are not those of the pictures, which are not known without "
        "a\n# camera file: they are the least that hold all corners. Correct them before use.\n"
    )
    return (least if camera.given is None else "") + camera_text(camera.camera)


def _intrinsics(
    camera: CameraEstimate,
) -> Iterator[tuple[str, float | None, float, float | None, Unit]]:
    values, stds = camera.camera.values, camera.camera.stds
    for k, (name, value) in enumerate(values.items()):
        given = None if camera.given is None else camera.given.values[name]
        std = None if stds is None else float(stds[k])
        yield name, given, value, std, "px" if name in (*FOCAL, *CENTRE) else "1"


def _left_out(calibration: PictureCalibration, model: ErrorModel) -> float | None:
    """RMS of pictures left out by one of the models, px; None of few pictures."""
    return calibration.errors[model].left_out if calibration.errors else None


def _predicted(calibration: PictureCalibration) -> str:
    """How well pictures are foretold that were left out, and what frames follow; empty of few."""
    if not calibration.errors:
        return ""
    error, model = calibration.errors[calibration.error_model], calibration.error_model
    stands = "the board" if calibration.setup == EYE_IN_HAND else "the camera"
    how = {
        "hand-errors": "each picture is weighted by the errors of the hand's poses",
        "mixed": f"X is weighted by the errors of the hand's poses, {100 * model.share:.0f} % of "
        f"the way to least squares, and {stands} is placed where the pixels fit best",
        "exact-hand": "the poses of the hand are taken as exact (least squares)",
    }[model.name]
    if model.camera_share:
        part = f"{100 * model.camera_share:.0f} % of the way to least squares"
        how += (
            f", and the intrinsics take up what is an error of the arm ({part}): use them with "
            "this X only"
        )
    return (
        f"reprojection rms {error.fitted:.3f} px in the fitted pictures, {error.left_out:.3f} px "
        f"in pictures left out in turn; {how}. In left-out pictures, least squares gives "
        f"{calibration.errors[MODELS[-1]].left_out:.3f} px and weighting alone "
        f"{calibration.errors[MODELS[0]].left_out:.3f} px"
    )


def _hand(noise: PictureNoise) -> str:
    """How far the hand is off."""
    low, high = noise.position.interval
    from_turn, to_turn = noise.rotation.interval
    sentence = (
        f"each pose of the hand is off by {mm(noise.position.value):.3f} mm "
        f"({mm(low):.3f} to {mm(high):.3f}) and {deg(noise.rotation.value):.3f}° "
        f"({deg(from_turn):.3f} to {deg(to_turn):.3f}) about each axis (one standard deviation)"
    )
    shift, turn = noise.shared
    if shift == 0.0:
        return (
            f"{sentence}. An error that all poses share, such as a tilted base, is not visible in "
            "pictures and not in ±"
        )
    return (
        f"{sentence}, and by {mm(shift):.3f} mm and {deg(turn):.3f}° that neighbouring poses "
        "share, as with wrong lengths or angles of the arm. An error that all poses share is not "
        "visible in pictures: ± assumes that it is about as large"
    )


def _fit(camera: CameraEstimate) -> Iterator[Part]:
    """How well the pictures agree, and which do not."""
    count, strange = len(camera.images), camera.strange
    sentence = f"reprojection rms {camera.rms:.3f} px"
    if camera.alone > 0 and camera.rms > ROBOTS * camera.alone:
        sentence += (
            f", of which the camera alone causes {camera.alone:.3f} px: the rest are errors of the "
            "poses that the robot reported"
        )
    yield Text(sentence)
    fitted = f"{count - len(strange)} of {count} pictures fitted"
    if strange:
        s = "s" * (len(strange) > 1)
        fitted += f"; {len(strange)} outlier{s}: {listed(strange, MOST_OUTLIERS)}"
    yield Text(fitted)


def _record(calibration: PictureCalibration, camera: CameraEstimate) -> Json:
    """A camera as JSON has it."""
    record: Json = {}
    for name in calibration.unknowns:
        record |= {name: getattr(camera, name), **pose_record(getattr(camera, name), f"{name}_")}
    size = 6 * len(calibration.unknowns)
    order = [f"{name}.{key}" for name in calibration.unknowns for key in PLACEMENT]
    judged = camera.inliers & np.isfinite(camera.slides[:, 0])
    return record | {
        "std": {name: pose_std_record(camera.std[name]) for name in calibration.unknowns},
        "rms_mm": plain(rms_length(camera.slides[judged]), "m"),
        "rms_deg": plain(rms_length(camera.turns[judged]), "rad"),
        "reprojection_rms_px": camera.rms,
        "camera_alone_rms_px": camera.alone,
        "camera": _camera_record(camera),
        "markers": None if camera.markers is None else marker_records(camera.markers),
        "intrinsics_held": None
        if camera.if_held is None
        else {"X": camera.if_held.X, "std": pose_std_record(camera.if_held.std)},
        "outlier_images": camera.strange,
        "covariance": covariance_record(camera.covariance[:size, :size], order, "m, rad"),
    }


def _named(calibration: PictureCalibration) -> Json:
    """X of every camera and Z of every board by name, with their standard deviations."""
    record: Json = {"X": {}, "Z": {}, "std": {"X": {}, "Z": {}}}
    for camera in reversed(calibration.cameras):
        for side, name in (("X", camera.label), ("Z", camera.target)):
            record[side][name] = getattr(camera, side)
            record["std"][side][name] = pose_std_record(camera.std["X" if side == "X" else "Z"])
    for lost in calibration.not_found:
        record["X"][lost.name] = record["std"]["X"][lost.name] = None
    fitted = [c.inliers & np.isfinite(c.slides[:, 0]) for c in calibration.cameras]
    pairs = [*zip(calibration.cameras, fitted, strict=True)]
    slides = np.concatenate([camera.slides[good] for camera, good in pairs])
    turns = np.concatenate([camera.turns[good] for camera, good in pairs])
    return record | {
        "rms_mm": plain(rms_length(slides), "m"),
        "rms_deg": plain(rms_length(turns), "rad"),
    }


def _camera_record(camera: CameraEstimate) -> Json:
    """Intrinsics with their standard deviations, null where they were held."""
    values, stds = camera.camera.intrinsics, camera.camera.stds
    none: Sequence[float | None] = [None] * len(values)
    std = none if stds is None else stds.tolist()
    known = camera.given is not None
    return {
        "width": camera.camera.width if known else None,
        "height": camera.camera.height if known else None,
        **dict(zip((*FOCAL, *CENTRE), values[:4].tolist(), strict=True)),
        "distortion_model": camera.camera.lens.name,
        "distortion": values[4:].tolist(),
        "lens_left_out_rms_px": None
        if camera.lens_choice is None
        else dict(camera.lens_choice.left_out),
        "std": {
            **dict(zip((*FOCAL, *CENTRE), std[:4], strict=True)),
            "distortion": list(std[4:]),
        },
    }


def picture_plot(calibration: PictureCalibration) -> str:
    """An SVG: errors by picture, and where in the picture corners are off."""
    rows = len(calibration.cameras)
    with picture(NAME, (LARGE, 3.2 * rows)) as figure:
        panels = figure.subplots(rows, 2, squeeze=False, width_ratios=(1.3, 1))
        inlier = {"marker": "o", "color": BLUE, "linestyle": "none", "ms": 4.5}
        for (by_picture, over), camera in zip(panels, calibration.cameras, strict=True):
            number, good = np.arange(len(camera.images)), camera.inliers
            by_picture.axhline(camera.rms, color=GREY, lw=1.2, ls="--", label="RMS")
            by_picture.plot(number[good], camera.picture_rms[good], label="fitted", **inlier)
            if not good.all():
                by_picture.plot(
                    number[~good],
                    camera.picture_rms[~good],
                    label="outlier",
                    **OUTLIER | {"ms": 8, "mew": 0.6},
                )
                by_picture.set_yscale("log")
            else:
                by_picture.set_ylim(bottom=0.0)
            by_picture.xaxis.set_major_locator(MaxNLocator(integer=True))
            by_picture.set(xlabel="picture (from 0)", ylabel="reprojection RMS, px")
            by_picture.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
            fitted = camera.corners[camera.corners[:, 6] > 0]
            u, v, du, dv = fitted[:, 2:6].T
            largest = max(float(np.hypot(du, dv).max(initial=0.0)), 1e-9)
            # The largest error is drawn as long as this part of the picture's width.
            scale = largest / (0.06 * camera.camera.width)
            over.quiver(u, v, du, dv, angles="xy", scale_units="xy", scale=scale, width=3e-3)
            over.set(xlim=(0, camera.camera.width), ylim=(camera.camera.height, 0), aspect="equal")
            over.set(xlabel="u, px", ylabel="v, px", title=f"errors × {1 / scale:.0f}")
        return svg_text(figure, NAME, "Reprojection errors by picture and over the picture")
