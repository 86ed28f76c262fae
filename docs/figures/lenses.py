"""The picture of the guide to cameras: `python docs/figures/lenses.py`.

A fisheye is calibrated twice from simulated corners: by boards in the middle of the picture, and by
boards everywhere. Drawn is how sure each is of where it sees a far point.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.colors import LogNorm

from suta_calib.geometry import rotation_from_vector
from suta_calib.geometry.lens import EQUIDISTANT
from suta_calib.geometry.numbers import vector_turning_z_to
from suta_calib.measurements import Camera, Chessboard, corners_of
from suta_calib.vision import CameraFit, CameraFitOptions, calibrate_camera

FOLDER = Path(__file__).resolve().parent
BOARD = Chessboard(9, 6, 0.03)
INTRINSICS = np.array([390.0, 390.0, 639.5, 479.5, -0.02, 0.003, -0.001, 0.0001])
CAMERA = Camera(1280, 960, INTRINSICS, lens=EQUIDISTANT)
# Pictures, and how well a corner is found, px.
PICTURES, SIGMA = 20, 0.1


def calibrated(room: tuple[float, float]) -> CameraFit:
    """The camera by boards whose middle is at least so far from the picture's edges, px."""
    random = np.random.default_rng(4)
    points = np.array(list(BOARD.points.values()))
    numbers = np.array(list(BOARD.points))
    rows = []
    for k in range(PICTURES):
        ahead = CAMERA.directions(random.uniform(room, np.array([1279.0, 959.0]) - room))
        turn = rotation_from_vector(vector_turning_z_to(ahead))
        turn = turn @ rotation_from_vector(random.uniform(-0.6, 0.6, 3))
        place = random.uniform(0.25, 0.4) * ahead - turn @ points.mean(axis=0)
        pixels = CAMERA.project(points @ turn.T + place)
        pixels = pixels + SIGMA * random.standard_normal(pixels.shape)
        seen = CAMERA.inside(pixels)
        rows.append((np.repeat(str(k), seen.sum()), numbers[seen], pixels[seen]))
    corners = corners_of(*map(np.concatenate, zip(*rows, strict=True)))
    options = CameraFitOptions(lens=EQUIDISTANT)
    return calibrate_camera(corners, BOARD, CAMERA.width, CAMERA.height, options)


def main() -> None:
    """Draw it."""
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
    levels = np.geomspace(0.01, 3.0, 12)
    for axes, room, title in (
        (panels[0], (480.0, 360.0), "boards in the middle"),
        (panels[1], (120.0, 120.0), "boards everywhere"),
    ):
        fit = calibrated(room)
        sure = fit.projection
        shown = axes.contourf(
            *(sure.u, sure.v, np.clip(sure.std, 0.0101, 2.99), levels),
            cmap="cividis",
            norm=LogNorm(0.01, 3.0),
        )
        axes.plot(*fit.used.pixel.T, ".", color="w", ms=0.8)
        axes.set(xlim=(0, 1279), ylim=(959, 0), aspect="equal", xlabel="u, px", title=title)
    panels[0].set_ylabel("v, px")
    bar = figure.colorbar(shown, ax=panels, ticks=[0.01, 0.03, 0.1, 0.3, 1, 3], shrink=0.9)
    bar.ax.set_yticklabels(["0.01", "0.03", "0.1", "0.3", "1", "3"])
    bar.ax.minorticks_off()
    bar.set_label("± where a far point is seen, px")
    figure.savefig(FOLDER / "lenses.png", dpi=110)


if __name__ == "__main__":
    main()
