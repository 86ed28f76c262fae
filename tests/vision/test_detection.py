"""Many pictures: which are used, why the others are not, and the camera they make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from vision_scenes import CAMERA, CHESSBOARD, facing, taken, truth, write_picture  # noqa: E402

from suta_calib.errors import InputError, SamplesError  # noqa: E402
from suta_calib.measurements import (  # noqa: E402
    Camera,
    Chessboard,
    Marker,
    Markers,
    corners_of,
    read_board,
)
from suta_calib.vision import (  # noqa: E402
    calibrate_camera,
    detect,
    find_pictures,
    read_picture,
    view_poses,
)

TAGS = "DICT_APRILTAG_36h11"
POINTS = np.arange(len(CHESSBOARD.points))


def views(count: int, seed: int = 1) -> list[np.ndarray]:
    """Poses of the board, tilted towards all sides, wholly in the picture."""
    random, found = np.random.default_rng(seed), []
    while len(found) < count:
        T = facing(CHESSBOARD, tuple(random.uniform(-40, 40, 3)), random.uniform(0.3, 0.45))
        T[:2, 3] += random.uniform(-0.05, 0.05, 2)
        if CAMERA.inside(truth(CHESSBOARD, POINTS, T)).all():
            found.append(T)
    return found


def seen(poses: list[np.ndarray], random: np.random.Generator, sigma: float = 0.1):
    pixel = [truth(CHESSBOARD, POINTS, T) for T in poses]
    names = np.repeat([f"{k}.png" for k in range(len(poses))], len(POINTS))
    noisy = np.concatenate(pixel) + sigma * random.standard_normal((len(names), 2))
    return corners_of(names, np.tile(POINTS, len(poses)), noisy)


def test_the_covariance_of_a_camera_is_its_scatter():
    poses, random = views(10), np.random.default_rng(3)
    fits = [calibrate_camera(seen(poses, random), CHESSBOARD, 320, 240) for _ in range(40)]
    errors = np.array([fit.camera.intrinsics - CAMERA.intrinsics for fit in fits])
    covariance = np.mean([fit.camera.covariance for fit in fits], axis=0)
    spread = errors.std(axis=0) / np.sqrt(np.diag(covariance))
    assert np.all((spread > 0.7) & (spread < 1.35))
    assert np.all(np.abs(errors.mean(axis=0)) < 3.5 * errors.std(axis=0) / np.sqrt(len(fits)))
    assert fits[0].assessment.level == "good"
    assert fits[0].rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_a_picture_that_does_not_fit_the_others_is_named():
    corners = seen(views(8), np.random.default_rng(4))
    moved = np.where((corners.image == "3.png") & (corners.point == 7), 25.0, 0.0)
    spoilt = replace(corners, pixel=corners.pixel + moved[:, None])
    fit = calibrate_camera(spoilt, CHESSBOARD, 320, 240)
    assert list(fit.astray) == ["3.png"]
    assert fit.camera.intrinsics[0] == pytest.approx(310.0, abs=4 * fit.camera.stds[0])


def test_boards_that_are_not_tilted_determine_no_camera():
    flat = []
    for k in range(6):
        T = facing(CHESSBOARD, (0, 0, 10 * k), 0.36 + 0.01 * k)
        flat.append(T)
    try:
        fit = calibrate_camera(seen(flat, np.random.default_rng(5)), CHESSBOARD, 320, 240)
    except SamplesError:
        return
    assert fit.assessment.level != "good"
    with pytest.raises(SamplesError, match="at least 3"):
        calibrate_camera(seen(flat[:2], np.random.default_rng(5)), CHESSBOARD, 320, 240)


def test_where_a_board_is_in_a_picture():
    T = views(1)[0]
    poses, residuals = view_poses(seen([T], np.random.default_rng(0), 0.0), CHESSBOARD, CAMERA)
    assert np.allclose(poses["0.png"], T, atol=1e-6)
    assert np.abs(residuals).max() < 1e-6


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five pictures of the board, and what else lies about in such folders."""
    folder = tmp_path_factory.mktemp("pictures")
    for k, T in enumerate(views(5)):
        write_picture(folder / f"good_{k}.png", taken(CHESSBOARD, T, seed=k))
    (folder / "copy.png").write_bytes((folder / "good_0.png").read_bytes())
    (folder / "cut.png").write_bytes((folder / "good_1.png").read_bytes()[:500])
    (folder / "nothing.png").write_bytes(b"")
    (folder / "words.jpg").write_text("no picture", encoding="utf-8")
    write_picture(folder / "dark.png", np.zeros((240, 320), np.uint8))
    write_picture(folder / "small.png", taken(CHESSBOARD)[20:220, 20:300])
    (folder / "notes.txt").write_text("not tried", encoding="utf-8")
    return folder


def test_what_cannot_be_used_is_named_and_left_out(folder: Path):
    done = []
    found = detect(
        find_pictures([folder]), CHESSBOARD, CAMERA, progress=lambda k, n: done.append((k, n))
    )
    lost = {view.picture.name: view.reason for view in found.views if view.board is None}
    assert {name: lost[name].split(":")[0] for name in sorted(lost)} == {
        "cut.png": "not a picture, or an incomplete one",
        "dark.png": "an empty picture",
        # Pictures are taken in the order of their names.
        "good_0.png": "the same picture as copy.png",
        "nothing.png": "an empty file",
        "small.png": "280x200 px where the camera's file has 320x240",
        "words.jpg": "not a picture, or an incomplete one",
    }
    assert found.detected == 5
    assert found.rms < 0.08
    assert found.assessment.level == "care"
    assert done[-1] == (11, 11)


def test_another_cameras_file_does_not_fit(folder: Path):
    values = CAMERA.intrinsics * [1, 1, 1, 1, 0, 0, 0, 0, 0] + [200, 0, 0, 0, 2.0, 0, 0, 0, 0]
    found = detect(find_pictures([folder]), CHESSBOARD, Camera(320, 240, values))
    assert not found.assessment.usable
    assert "does not fit the pictures" in found.assessment.notes[0]


@pytest.mark.parametrize(
    ("size", "advice"),
    [
        ((640, 480), "multiply fx and fy in its file by 0.5"),
        ((320, 200), "cut out or stretched"),
        ((240, 320), "not turned by their EXIF entry"),
    ],
)
def test_a_camera_of_pictures_of_another_size_is_refused_with_a_remedy(
    folder: Path, size: tuple[int, int], advice: str
) -> None:
    pictures = find_pictures([folder / "good_0.png", folder / "good_1.png"])
    with pytest.raises(SamplesError, match="pictures of 320x240 px") as refused:
        detect(pictures, CHESSBOARD, Camera(*size, CAMERA.intrinsics))
    assert f"{size[0]}x{size[1]} px" in refused.value.expected
    assert advice in refused.value.hint


def test_a_camera_with_another_focus_is_named(folder: Path) -> None:
    values = CAMERA.intrinsics * [1.05, 1.05, 1, 1, 1, 1, 1, 1, 1]
    found = detect(find_pictures([folder]), CHESSBOARD, Camera(320, 240, values))
    assert any(f"(fx {values[0]:.1f} →" in note for note in found.assessment.notes)
    assert found.assessment.level == "care"


def test_no_board_anywhere_says_what_there_was(folder: Path):
    with pytest.raises(InputError, match="6x5 inner corners instead of 7x4"):
        detect(find_pictures([folder / "good_0.png"]), Chessboard(7, 4, 0.03))


def test_a_file_of_markers_that_no_camera_fits_says_so(tmp_path: Path):
    """Markers with y down at places with y up are read as seen; two exchanged ones are refused."""
    places = {n: np.array([0.06 * (n % 3), 0.06 * (n // 3), 0.0]) for n in range(6)}
    for k in range(4):
        board = Markers(TAGS, {n: Marker(p, 0.04) for n, p in places.items()})
        write_picture(
            tmp_path / f"{k}.png", taken(board, facing(board, (25 - 15 * k, 10 * k - 20, 0)))
        )
    up = {n: Marker(p * [1, -1, 1], 0.04) for n, p in places.items()}
    found = detect(find_pictures([tmp_path]), Markers(TAGS, up))
    assert found.rms < 0.2
    assert "y up" in found.assessment.notes[-1]
    exchanged = up | {0: up[5], 5: up[0]}
    for camera in (None, CAMERA):
        found = detect(find_pictures([tmp_path]), Markers(TAGS, exchanged), camera)
        assert not found.assessment.usable
        assert found.rms is None or found.rms < 320
    assert (
        "no camera model can explain"
        in detect(find_pictures([tmp_path]), Markers(TAGS, exchanged)).assessment.notes[0]
    )


def test_columns_for_rows_are_the_same_board_on_its_side(folder: Path):
    """No picture tells which of them was meant, so that it is said once."""
    pictures = find_pictures([folder / f"good_{k}.png" for k in range(5)])
    right = detect(pictures, CHESSBOARD, CAMERA)
    exchanged = detect(pictures, CHESSBOARD.exchanged, CAMERA)
    assert not any("on its side" in note for note in right.assessment.notes)
    (note,) = exchanged.assessment.notes
    assert note.startswith("In 5 of 5 pictures the board lies on its side: rows of 5 corners run")
    assert exchanged.assessment.level == right.assessment.level == "good"
    # The same corners, numbered along the other side.
    grid = right.corners.pixel[:30].reshape(CHESSBOARD.rows, CHESSBOARD.columns, 2)
    turned = exchanged.corners.pixel[:30].reshape(CHESSBOARD.columns, CHESSBOARD.rows, 2)
    ways = [np.abs(np.rot90(grid, way) - turned).max() for way in (1, 3)]
    assert min(ways) < 1e-3


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_pictures_of_more_bits_lose_none_that_count(bits: int, tmp_path: Path):
    """A sensor of 12 bits leaves the upper four of 16 empty: cut to eight it would keep four."""
    eight = np.arange(256, dtype=np.uint8).repeat(64).reshape(128, 128)
    deep = eight.astype(np.uint16) << (bits - 8)
    # A pixel that shines is no measure of the others.
    deep[3, 5] = 2**16 - 1
    read = read_picture(write_picture(tmp_path / "deep.png", deep))
    expected = eight.copy()
    expected[3, 5] = 255
    assert read.dtype == np.uint8
    assert np.array_equal(read, expected)


def test_pictures_of_fractions_and_of_colours_with_alpha(tmp_path: Path):
    eight = np.arange(256, dtype=np.uint8).repeat(64).reshape(128, 128)
    fractions = write_picture(tmp_path / "f.tiff", eight.astype(np.float32) / 255)
    assert np.array_equal(read_picture(fractions), eight)
    clear = np.dstack([eight, eight, eight, np.zeros_like(eight)])
    assert np.array_equal(read_picture(write_picture(tmp_path / "clear.png", clear)), eight)


def test_names_of_pictures(tmp_path: Path):
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        write_picture(tmp_path / side / "1.png", np.zeros((9, 9), np.uint8))
    sides = [tmp_path / "left", tmp_path / "right"]
    assert [each.name for each in find_pictures(sides)] == ["left/1.png", "right/1.png"]
    assert [each.name for each in find_pictures(sides[:1])] == ["1.png"]
    assert len(find_pictures([sides[0], sides[0] / "1.png"])) == 1
    with pytest.raises(InputError, match=r"a folder without pictures .*such as left"):
        find_pictures([tmp_path])
    with pytest.raises(InputError, match="no such file"):
        find_pictures([tmp_path / "none.png"])


def test_pictures_with_known_truth(shared: Path):
    scene = shared / "images" / "workcell_camera1"
    pictures = find_pictures([scene / "images"])[::8]
    from suta_calib.measurements import read_camera

    camera = read_camera(scene / "camera.yaml")
    found = detect(pictures, read_board(scene / "board.yaml"), camera)
    assert found.detected == len(pictures)
    assert found.rms < 0.05
    assert found.assessment.level == "good"
