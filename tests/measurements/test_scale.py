"""``grade`` and ``scale_ppm``: how well the unit of a body's lengths is known."""

from __future__ import annotations

from pathlib import Path

import pytest

from suta_calib.errors import ArtefactError, BoardError
from suta_calib.measurements import (
    LengthScale,
    read_artefact,
    read_board,
    write_artefact,
    write_board,
)
from suta_calib.measurements.scale import stretch_prior

TWO_MARKS = "landmarks:\n  A: {{position_mm: [0, 0, 0]{0}}}\n  B: {{position_mm: [100, 0, 0]}}\n"
CHESSBOARD = "type: chessboard\ncorners: [7, 5]\nsquare_mm: 30\n"


@pytest.mark.parametrize(
    ("head", "sigma", "expected"),
    [
        # A drawing that nobody measured; a body that somebody did.
        ("", "", LengthScale(200e-6, "machined")),
        ("", ", sigma_mm: 0.01", LengthScale(20e-6, "certified")),
        ("grade: printed\n", ", sigma_mm: 0.01", LengthScale(5000e-6, "printed")),
        ("scale_ppm: 0\n", "", LengthScale(0.0)),
        ("grade: certified\nscale_ppm: 8\n", "", LengthScale(8e-6, "certified")),
    ],
)
def test_an_artefact_says_how_well_its_scale_is_known(
    tmp_path: Path, head: str, sigma: str, expected: LengthScale
) -> None:
    path = tmp_path / "artefact.yaml"
    path.write_text(head + TWO_MARKS.format(sigma))

    found = read_artefact(path).length_scale

    assert found.grade == expected.grade
    assert found.std == pytest.approx(expected.std)


@pytest.mark.parametrize("head", ["", "grade: certified\n", "grade: printed\nscale_ppm: 900\n"])
def test_files_are_written_with_what_was_said_and_no_more(tmp_path: Path, head: str) -> None:
    body, board = tmp_path / "artefact.yaml", tmp_path / "board.yaml"
    body.write_text(head + TWO_MARKS.format(""))
    board.write_text(CHESSBOARD + head)
    before = read_artefact(body).scale, read_board(board).scale

    write_artefact(body, read_artefact(body))
    write_board(board, read_board(board))

    assert (read_artefact(body).scale, read_board(board).scale) == before
    assert ("grade" in body.read_text()) == ("grade" in head)


def test_a_board_counts_as_printed_until_its_file_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(CHESSBOARD)
    assert read_board(path).length_scale.sentence == "printed, 5,000 ppm"
    path.write_text(CHESSBOARD + "grade: machined\n")
    assert read_board(path).length_scale.ppm == pytest.approx(200)
    assert read_board(path).scaled(2.0).length_scale.grade == "machined"


def test_what_is_no_scale_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "artefact.yaml"
    path.write_text("grade: precise\n" + TWO_MARKS.format(""))
    with pytest.raises(ArtefactError, match=r":1: grade: .*certified, machined, printed"):
        read_artefact(path)
    path.write_text("scale_ppm: 254000\n" + TWO_MARKS.format(""))
    with pytest.raises(ArtefactError, match=r":1: scale_ppm: .*at most 100000 ppm"):
        read_artefact(path)
    path = tmp_path / "board.yaml"
    path.write_text(CHESSBOARD + "scale_ppm: -1\n")
    with pytest.raises(BoardError, match=r":4: scale_ppm"):
        read_board(path)


@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        (None, 5e-3 * 2**0.5),
        (LengthScale.of_grade("printed"), 5e-3 * 2**0.5),
        (LengthScale(1e-3, "printed"), 1e-3),
    ],
)
def test_the_mean_stretch_varies_as_the_grade(scale: LengthScale | None, expected: float) -> None:
    assert stretch_prior(scale) == pytest.approx(expected)
