"""``suta-calib stereotactic``: files in, files out, and refusals."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from cli_job import Capture, answer, cli, printed, refused

from suta_calib.stereotactic.cis_files import read_output1, read_points
from suta_calib.stereotactic.cis_simulation import SimulatedSet, simulate_stereotactic

NAME = "sim"
MADE = simulate_stereotactic(NAME, seed=2, distortion=3e-3, em_noise=0.05e-3, grid=3)


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """A simulated set that can be solved, until a test spoils it."""
    folder = tmp_path / "data"
    folder.mkdir()
    return MADE.write(folder)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


@pytest.fixture(autouse=True)
def told() -> Iterator[None]:
    """Warnings are lines on stderr here; what they say is tested with the solver."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        yield


def of(prefix: Path, kind: str) -> Path:
    return prefix.with_name(f"{prefix.name}-{kind}.txt")


def refuses(prefix: Path, out: Path, *options: object) -> str:
    """The one line that says why; nothing is written."""
    line = refused("stereotactic", prefix, "--out", out, *options)
    assert not out.exists() or list(out.iterdir()) == []
    return line


def test_first_assignment(prefix: Path, out: Path) -> None:
    found = answer("stereotactic", prefix, "--out", out)
    assert {f.name for f in out.iterdir()} == {f"{NAME}-output1.txt", f"{NAME}-stereotactic.svg"}
    output = read_output1(out / f"{NAME}-output1.txt")
    np.testing.assert_allclose(1e3 * output.em_post, found["em_post_mm"], atol=0.0051)
    np.testing.assert_allclose(1e3 * output.optical_post, found["optical_post_mm"], atol=0.0051)
    np.testing.assert_allclose(output.expected, MADE.truth.expected, atol=2e-5)
    assert "nav_mm" not in found
    assert "degree" not in found
    comparison = found["comparison"]
    assert comparison["c_expected_mean_mm"] < 0.01
    assert comparison["em_post_mm"] > 1.0
    assert found["verdict"]["level"] == "care"


@pytest.mark.usefixtures("drawn")
def test_second_assignment(prefix: Path, out: Path) -> None:
    found = answer("stereotactic", prefix, "--out", out, "--dewarp")
    assert {f.name for f in out.iterdir()} == {
        f"{NAME}-output1.txt",
        f"{NAME}-output2.txt",
        f"{NAME}-stereotactic.svg",
    }
    assert set(found["files"]) == {f.name for f in out.iterdir()}
    tips = read_points(out / f"{NAME}-output2.txt")
    np.testing.assert_allclose(1e3 * tips, found["nav_mm"], atol=0.0051)
    np.testing.assert_allclose(tips, MADE.truth.navigation, atol=0.3e-3)
    assert found["degree"] >= 3
    assert set(found["extrapolated"]) == {"em_pivot", "em_fiducials", "em_nav"}
    comparison = found["comparison"]
    assert comparison["em_post_mm"] < 0.2
    assert comparison["nav_mean_mm"] < 0.2
    assert np.shape(found["T_ct_em"]) == (4, 4)
    assert len(found["em_post_std_mm"]) == len(found["optical_post_std_mm"]) == 3
    ElementTree.parse(out / f"{NAME}-stereotactic.svg")


def test_an_answer_that_must_not_be_used_is_written_all_the_same(prefix: Path, out: Path) -> None:
    """Where the optical tracker says the markers were does not hang on how they were read."""
    counts, *rows = of(prefix, "calreadings").read_text().splitlines()
    frames = np.array(rows).reshape(-1, 8 + 8 + 27)
    frames[:, 16:] = frames[:, 16:][:, np.random.default_rng(0).permutation(27)]
    of(prefix, "calreadings").write_text("\n".join([counts, *frames.ravel()]) + "\n")
    found = answer("stereotactic", prefix, "--out", out, code=1)
    assert not found["verdict"]["usable"]
    assert "order of the C markers" in found["verdict"]["notes"][0]
    output = read_output1(out / f"{NAME}-output1.txt")
    np.testing.assert_allclose(output.expected, MADE.truth.expected, atol=2e-5)


def test_headers_and_layout(prefix: Path, out: Path) -> None:
    assert cli("stereotactic", prefix, "--out", out, "--dewarp") == 0
    first = (out / f"{NAME}-output1.txt").read_text().split("\n")
    assert first[0] == f"27, 27, {NAME}-output1.txt"
    assert len(first) == 1 + 2 + 27 * 27 + 1
    second = (out / f"{NAME}-output2.txt").read_text().split("\n")
    assert second[0] == f"4, {NAME}-output2.txt"
    for row in (*first[1:-1], *second[1:-1]):
        assert row == ", ".join(f"{float(cell):8.2f}" for cell in row.split(","))


@pytest.mark.parametrize("dewarp", [False, True])
def test_table(prefix: Path, out: Path, dewarp: bool) -> None:
    shown = printed("stereotactic", prefix, "--out", out, *(["--dewarp"] if dewarp else []))
    assert "optical post" in shown
    assert ("tip in CT" in shown) == dewarp
    assert ("Use --dewarp to correct it" in shown) != dewarp
    assert f"{NAME}-output1.txt" in shown


def test_a_wrong_marker_is_left_out_unless_all_are_to_be_believed(prefix: Path, out: Path) -> None:
    path = of(prefix, "optpivot")
    lines = path.read_text().splitlines()
    x, y, z = map(float, lines[1 + 8].split(","))
    lines[1 + 8] = f"{x + 8:8.2f}, {y - 6:8.2f}, {z + 9:8.2f}"
    path.write_text("\n".join(lines) + "\n")
    believed = answer("stereotactic", prefix, "--out", out, "--no-robust")
    unasked = answer("stereotactic", prefix, "--out", out)
    found = answer("stereotactic", prefix, "--out", out, "--robust")
    assert unasked["comparison"]["optical_post_mm"] < 0.02
    assert believed["comparison"]["optical_post_mm"] > 0.1
    assert found["comparison"]["optical_post_mm"] < 0.02
    assert found["marker_outliers"]["optpivot"] >= 1
    assert "marker_outliers" not in believed


def test_without_given_outputs_there_is_nothing_to_compare(prefix: Path, out: Path) -> None:
    for kind in ("output1", "output2"):
        of(prefix, kind).unlink()
    assert answer("stereotactic", prefix, "--out", out, "--dewarp")["comparison"] == {}


def test_the_other_spelling_is_read(prefix: Path, out: Path) -> None:
    of(prefix, "em-fiducials").rename(of(prefix, "em-fiducialss"))
    assert answer("stereotactic", prefix, "--out", out, "--dewarp")["nav_mm"]


def test_without_navigation_files_only_the_first_output(prefix: Path, out: Path) -> None:
    for kind in ("ct-fiducials", "em-fiducials", "EM-nav"):
        of(prefix, kind).unlink()
    assert answer("stereotactic", prefix, "--out", out, "--dewarp")["nav_mm"] is None
    assert not (out / f"{NAME}-output2.txt").exists()


def test_a_missing_navigation_file_is_told(prefix: Path, out: Path, capsys: Capture) -> None:
    of(prefix, "EM-nav").unlink()
    assert cli("stereotactic", prefix, "--out", out, "--dewarp") == 0
    assert "EM-nav.txt" in capsys.readouterr().err
    assert not (out / f"{NAME}-output2.txt").exists()


def test_given_outputs_are_not_replaced(prefix: Path) -> None:
    before = {f.name: f.read_bytes() for f in prefix.parent.iterdir()}
    assert "choose another folder" in refused("stereotactic", prefix, "--out", prefix.parent)
    assert {f.name: f.read_bytes() for f in prefix.parent.iterdir()} == before
    of(prefix, "output1").unlink()
    assert cli("stereotactic", prefix, "--out", prefix.parent) == 0
    assert cli("stereotactic", prefix, "--out", prefix.parent) == 0


Spoil = Callable[[Path], object]


def line(kind: str, number: int, text: str | None) -> Spoil:
    """Another text for one line of a file, or none."""

    def spoil(prefix: Path) -> None:
        path = of(prefix, kind)
        lines = path.read_text().splitlines()
        lines[number - 1 : number] = [] if text is None else [text]
        path.write_text("\n".join(lines) + "\n")

    return spoil


def missing(kind: str) -> Spoil:
    return lambda prefix: of(prefix, kind).unlink()


def empty(kind: str) -> Spoil:
    return lambda prefix: of(prefix, kind).write_text("")


def mirrored(prefix: Path) -> None:
    """The calibration body in left-handed axes."""
    path = of(prefix, "calbody")
    header, *rows = path.read_text().splitlines()
    flipped = [",".join([*row.split(",")[:2], str(-float(row.split(",")[2]))]) for row in rows]
    path.write_text("\n".join([header, *flipped]) + "\n")


def still(prefix: Path) -> None:
    """A pivot without turning: the first frame again and again."""
    path = of(prefix, "empivot")
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *(rows[:6] * 12)]) + "\n")


@pytest.mark.parametrize(
    ("spoil", "options", "says"),
    [
        (missing("calbody"), [], ("sim-calbody.txt", "PREFIX is the part of the name before")),
        (missing("optpivot"), [], ("sim-optpivot.txt", "no such file")),
        (empty("empivot"), [], ("sim-empivot.txt", "empty")),
        (line("calreadings", 9, "1, 2"), [], ("sim-calreadings.txt:9", "three numbers")),
        (line("calreadings", 9, None), [], ("rows of points", "cut off")),
        (line("empivot", 5, "1, nan, 2"), [], ("sim-empivot.txt:5", "nan")),
        (line("optpivot", 1, "8, 6, -12, x"), [], ("sim-optpivot.txt:1", "N_frames", "-12")),
        (line("optpivot", 1, "6, 8, 12, x"), [], ("N_D", "found 6", "sim-calbody.txt has 8")),
        (line("calbody", 1, "8, 9, 26, x"), [], ("sim-calreadings.txt:1", "N_A")),
        (mirrored, [], ("sim-calreadings.txt", "frame 1", "mirror")),
        (still, [], ("sim-empivot.txt", "turn the tool")),
        (line("output1", 1, "26, 64, x"), [], ("sim-output1.txt", "rows of points")),
        (line("EM-nav", 2, "a, b, c"), ["--dewarp"], ("sim-EM-nav.txt:2", "a, b, c")),
        (line("EM-nav", 1, "4, 6, x"), ["--dewarp"], ("sim-EM-nav.txt:1", "N_G")),
        (line("em-fiducials", 1, "4, 9, x"), ["--dewarp"], ("sim-em-fiducials.txt:1", "N_frames")),
        (line("output2", 3, "x"), ["--dewarp"], ("sim-output2.txt:3", "three numbers")),
    ],
)
def test_bad_input(
    spoil: Spoil, options: list[str], says: tuple[str, ...], prefix: Path, out: Path
) -> None:
    spoil(prefix)
    error = refuses(prefix, out, *options)
    for words in says:
        assert words in error


def test_navigation_files_do_not_matter_without_dewarp(prefix: Path, out: Path) -> None:
    line("EM-nav", 2, "a, b, c")(prefix)
    assert cli("stereotactic", prefix, "--out", out) == 0


def test_one_frame_cannot_be_corrected(tmp_path: Path, out: Path) -> None:
    seen = MADE.data.readings
    first = type(seen)(seen.base[:1], seen.optical[:1], seen.em[:1])
    data = type(MADE.data)(
        Path("one"), MADE.data.body, first, MADE.data.em_pivot, MADE.data.optical_pivot
    )
    prefix = SimulatedSet(data, MADE.truth).write(tmp_path)
    of(prefix, "output1").unlink()
    assert "1 frame of calibration readings" in refuses(prefix, out, "--dewarp")
    assert cli("stereotactic", prefix, "--out", out) == 0


def test_bad_usage(prefix: Path, out: Path) -> None:
    assert "--out" in refused("stereotactic", prefix)
    out.write_text("mine")
    assert "expected a folder" in refused("stereotactic", prefix, "--out", out)
    assert out.read_text() == "mine"
