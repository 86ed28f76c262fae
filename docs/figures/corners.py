"""The picture of the guide to corners: `python docs/figures/corners.py`.

Pictures of three boards that stand upright before a camera, as they are rendered; on them are the
numbers and frames that the package gives their points.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from suta_calib.arrays import FloatArray
from suta_calib.measurements import Board, Camera, Charuco, Chessboard, Marker, Markers
from suta_calib.vision import RenderOptions, rendered
from suta_calib.vision.pictures import Grey

FOLDER = Path(__file__).resolve().parent
CAMERA = Camera(460, 380, np.array([600.0, 600.0, 229.5, 189.5, 0.0, 0.0, 0.0, 0.0, 0.0]))
BOARDS: dict[str, Board] = {
    "chessboard, corners: [4, 3]": Chessboard(4, 3, 0.04),
    "charuco, squares: [5, 4]": Charuco(5, 4, 0.04, 0.028, "DICT_4X4_50"),
    "markers 2 and 7": Markers(
        "DICT_4X4_50",
        {2: Marker(np.array([0.0, 0.0, 0.0]), 0.07), 7: Marker(np.array([0.11, 0.05, 0.0]), 0.07)},
    ),
}
# Length of the axes that are drawn, m.
LENGTH = 0.03


def facing(board: Board) -> FloatArray:
    """``T_camera_board`` (4, 4) of a board that stands upright before the camera."""
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.0, 0.42]
    pose[:3, 3] -= np.mean(list(board.points.values()), axis=0)
    return pose


@cache
def picture(board: Board) -> Grey:
    """A board as the camera sees it."""
    how = RenderOptions(noise=0.0)
    return rendered(board, CAMERA, facing(board), np.random.default_rng(0), how)


def draw(axes: Axes, title: str, board: Board) -> None:
    """A board as it is seen, the numbers of its points, and its frame."""
    pose = facing(board)
    axes.imshow(picture(board), cmap="gray", vmax=255)
    for number, point in board.points.items():
        u, v = CAMERA.project(point + pose[:3, 3])
        axes.plot(u, v, "o", color="#1f77b4", markersize=3.5)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}
        axes.text(u + 5, v - 6, str(number), fontsize=7.5, color="#0b3d66", bbox=box)
    for end, colour, name in (([1, 0, 0], "#d62728", "x"), ([0, 1, 0], "#2ca02c", "y")):
        start, tip = CAMERA.project(np.array([np.zeros(3), LENGTH * np.array(end)]) + pose[:3, 3])
        arrow = {"arrowstyle": "-|>", "color": colour, "lw": 2.2}
        axes.annotate("", tip, start, arrowprops=arrow)
        axes.text(*(tip + 0.18 * (tip - start)), name, color=colour, ha="center", va="center")
    axes.set_title(title, fontsize=9)
    axes.set_xlabel("u, px", fontsize=8)
    axes.tick_params(labelsize=7)


def main() -> None:
    """Draw it."""
    figure, panels = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained", sharey=True)
    for axes, (title, board) in zip(panels, BOARDS.items(), strict=True):
        draw(axes, title, board)
    panels[0].set_ylabel("v, px", fontsize=8)
    figure.savefig(FOLDER / "corners.png", dpi=120)


if __name__ == "__main__":
    main()
