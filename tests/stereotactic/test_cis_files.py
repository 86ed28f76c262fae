"""The course's files: what they say is read exactly, what they cannot say is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reading import write

from suta_calib.errors import SamplesError
from suta_calib.stereotactic.cis_files import (
    Output1,
    output1_text,
    points_text,
    read_calibration_body,
    read_calibration_readings,
    read_em_frames,
    read_optical_pivot,
    read_output1,
    read_points,
)

FRAMES = "2, 2, frames.txt\n1,2,3\n4,5,6\n7,8,9\n10,11,12\n"
# Whole hundredths of a millimetre, as many as the eight characters hold.
hundredths = st.integers(-999_999, 9_999_999)


def points(*shape: int) -> st.SearchStrategy[np.ndarray]:
    """Points in m that the format's two decimals of a millimetre hold exactly."""
    return arrays(np.int64, (*shape, 3), elements=hundredths).map(lambda n: n * 1e-5)


def refusal(folder: Path, text: str | bytes, read: Callable[[Path], object]) -> SamplesError:
    path = write(folder, text, "bad.txt")
    with pytest.raises(SamplesError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return caught.value


@given(data=st.data(), frames=st.integers(1, 3), markers=st.integers(1, 4))
def test_output1_comes_back(data: st.DataObject, frames: int, markers: int, scratch: Path) -> None:
    posts, expected = data.draw(points(2)), data.draw(points(frames, markers))
    scratch.write_text(output1_text(Output1(posts[0], posts[1], expected), "a-output1.txt"))
    back = read_output1(scratch)
    np.testing.assert_allclose(back.em_post, posts[0], atol=1e-9)
    np.testing.assert_allclose(back.optical_post, posts[1], atol=1e-9)
    assert back.expected.shape == expected.shape
    np.testing.assert_allclose(back.expected, expected, atol=1e-9)


@given(tips=st.integers(1, 5).flatmap(lambda n: points(n)))
def test_output2_comes_back(tips: np.ndarray, scratch: Path) -> None:
    scratch.write_text(points_text((len(tips),), "a-output2.txt", tips))
    np.testing.assert_allclose(read_points(scratch), tips, atol=1e-9)


@given(text=st.text(st.characters(codec="utf-8"), max_size=200))
def test_any_text_is_read_or_refused(text: str, scratch: Path) -> None:
    scratch.write_text("1, 2, name\n" + text, newline="")
    try:
        frames = read_em_frames(scratch)
    except SamplesError as error:
        frames = None
        message = str(error)
    if frames is None:
        assert str(scratch) in message
    else:
        assert frames.shape == (2, 1, 3)
        assert np.isfinite(frames).all()


def test_layout_is_that_of_the_course() -> None:
    text = output1_text(
        Output1(np.array([0.20068, 0.19828, -1.5]), np.zeros(3), np.full((1, 1, 3), -1e-7)),
        "a-output1.txt",
    )
    assert text == (
        "1, 1, a-output1.txt\n"
        "  200.68,   198.28, -1500.00\n"
        "    0.00,     0.00,     0.00\n"
        "    0.00,     0.00,     0.00\n"
    )


def test_given_outputs_are_written_as_they_were(shared: Path) -> None:
    """Every output file of the course, read and written again, byte for byte."""
    folders = [shared / "cis_pa1", shared / "cis_pa2"]
    files = [f for folder in folders for f in sorted(folder.glob("*-output[12].txt"))]
    if not files:
        pytest.skip("no files of the course among the measured data")
    for file in files:
        if "output1" in file.name:
            text = output1_text(read_output1(file), file.name)
        else:
            points = read_points(file)
            text = points_text((len(points),), file.name, points)
        assert text.encode() == file.read_bytes(), file.name


def test_each_kind_is_split_as_its_header_says(tmp_path: Path) -> None:
    rows = [np.full(3, 1e-3 * k) for k in range(12)]
    body = write(tmp_path, points_text((1, 2, 3), "n", *rows[:6]), "body")
    parts = read_calibration_body(body)
    assert [len(p) for p in (parts.base, parts.optical, parts.em)] == [1, 2, 3]
    assert parts.em[0, 0] == pytest.approx(3e-3)
    seen = read_calibration_readings(write(tmp_path, points_text((1, 2, 3, 2), "n", *rows), "seen"))
    assert seen.em.shape == (2, 3, 3)
    assert seen.optical[1, 0, 0] == pytest.approx(7e-3)
    pivot = read_optical_pivot(write(tmp_path, points_text((1, 3, 3), "n", *rows), "pivot"))
    assert pivot.probe.shape == (3, 3, 3)
    assert pivot.base[2, 0, 0] == pytest.approx(8e-3)
    frames = read_em_frames(write(tmp_path, points_text((3, 4), "n", *rows), "frames"))
    assert frames[3, 2, 0] == pytest.approx(11e-3)


@pytest.mark.parametrize(
    "text",
    [
        FRAMES.replace("2, 2, ", "2,2,"),
        FRAMES.replace("2, 2, ", "  2 ,\t2 ,  "),
        FRAMES.replace("\n", "\r\n"),
        FRAMES.rstrip("\n"),
        FRAMES + "\n  \n",
        "\ufeff" + FRAMES,
        FRAMES.replace("1,2,3", "  1.00,  2.0e0 ,3"),
    ],
)
def test_blanks_and_line_ends_do_not_matter(text: str, tmp_path: Path) -> None:
    frames = read_em_frames(write(tmp_path, text, "a.txt"))
    np.testing.assert_allclose(frames.ravel(), 1e-3 * np.arange(1, 13))


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("", None, "empty"),
        (" \n\n", None, "empty"),
        (FRAMES.replace("2, 2, frames.txt", "2, 2"), 1, "header"),
        (FRAMES.replace("2, 2, frames.txt", "frames.txt"), 1, "N_G, N_frames, name"),
        (FRAMES.replace("2, 2,", "2, two,"), 1, "N_frames"),
        (FRAMES.replace("2, 2,", "0, 2,"), 1, "N_G"),
        (FRAMES.replace("2, 2,", "-2, -2,"), 1, "whole number"),
        (FRAMES.replace("2, 2,", "2.0, 2,"), 1, "whole number"),
        (FRAMES.replace("2, 2,", "1_0, 2,"), 1, "whole number"),
        (FRAMES.replace("2, 2,", "2, 99999999999999999999,"), 1, "whole number"),
        (FRAMES.replace("2, 2,", "2, 999999999,"), 6, "1999999998"),
        (FRAMES.replace("10,11,12\n", ""), 5, "cut off"),
        (FRAMES.replace("10,11,12\n", "10,11"), 5, "middle of a row"),
        (FRAMES + "13,14,15\n", 6, "surplus"),
        (FRAMES.replace("4,5,6\n", "4,5,6\n\n"), 4, "three numbers"),
        (FRAMES.replace("4,5,6", "4,5"), 3, "three numbers"),
        (FRAMES.replace("4,5,6", "4,5,6,7"), 3, "three numbers"),
        (FRAMES.replace("4,5,6", "4 5 6"), 3, "three numbers"),
        (FRAMES.replace("4,5,6", "4,x,6"), 3, "'4,x,6'"),
        (FRAMES.replace("4,5,6", "4,nan,6"), 3, "nan"),
        (FRAMES.replace("4,5,6", "4,-inf,6"), 3, "inf"),
        (FRAMES.replace("4,5,6", "4,1e200,6"), 3, "1e200"),
        (FRAMES.replace("4,5,6", "4,5_0,6"), 3, "5_0"),
        (FRAMES.encode("utf-16"), 1, "UTF-8"),
    ],
)
def test_bad_content_is_refused(
    text: str | bytes, line: int | None, says: str, tmp_path: Path
) -> None:
    error = refusal(tmp_path, text, read_em_frames)
    assert error.line == line
    assert says in str(error)


@pytest.mark.parametrize(
    ("read", "header"),
    [
        (read_calibration_body, "1, 1, 1, n"),
        (read_calibration_readings, "1, 1, 1, 1, n"),
        (read_optical_pivot, "1, 2, 1, n"),
        (read_output1, "1, 1, n"),
        (read_points, "3, n"),
    ],
)
def test_rows_are_counted_in_every_kind(
    read: Callable[[Path], object], header: str, tmp_path: Path
) -> None:
    rows = "1,2,3\n" * 3
    read(write(tmp_path, f"{header}\n{rows}", "good.txt"))
    assert "2 rows" in str(refusal(tmp_path, f"{header}\n{rows[6:]}", read))
    assert "4 rows" in str(refusal(tmp_path, f"{header}\n{rows}1,2,3\n", read))
