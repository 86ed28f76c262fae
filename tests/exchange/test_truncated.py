"""A file that was cut off is refused, or gives exactly what is whole of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign import imported
from foreign_samples import SAMPLES, P

from suta_calib.errors import InputError, SutaCalibError
from suta_calib.exchange import ImportedRows, read_foreign
from suta_calib.exchange.imported import Imported

# Formats that are read by other libraries, or in a process of their own.
SLOW = ("rosbag", "lerobot-dataset", "mjcf")
# Files that state how many rows they have, or have an end of their own.
STATED = ("qualisys", "krl", "rapid", "ur-script", "plus-sequence")


def is_prefix(part: Imported, whole: Imported) -> bool:
    """Whether all rows are the first ones of the whole file, number for number."""
    if not isinstance(part, ImportedRows) or not isinstance(whole, ImportedRows):
        return part.text() == whole.text()
    return list(part.columns) == list(whole.columns) and all(
        np.array_equal(values, whole.columns[name][: len(part)])
        for name, values in part.columns.items()
    )


@pytest.mark.parametrize(
    ("last", "before"), [(16, 3), pytest.param(300, 100, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_cut_at_any_byte_is_refused_or_read_right(
    name: str, last: int, before: int, tmp_path: Path
) -> None:
    """Cut at each of its last bytes, and at some places before."""
    sample = SAMPLES[name](tmp_path)
    path = sample.path
    if path.is_dir():
        path = max(path.rglob("*.*"), key=lambda each: each.stat().st_size)
    whole, content = read_foreign(sample.path, name, **sample.options), path.read_bytes()
    rng = np.random.default_rng(0)
    if name in SLOW:
        last, before = last // 8, before // 3
    cuts = [*range(max(1, len(content) - last), len(content))]
    cuts += rng.integers(1, len(content), before).tolist()
    wrong = []
    for cut in cuts:
        path.write_bytes(content[:cut])
        try:
            found = read_foreign(sample.path, name, **sample.options)
        except SutaCalibError:
            continue
        if name == "dh" and content[cut - 1 : cut + 1].count(b"\n"):
            continue  # a URDF of fewer joints
        at_line_end = content[cut - 1 : cut] == b"\n" or content[cut : cut + 1] == b"\n"
        shorter = at_line_end and name not in STATED and is_prefix(found, whole)
        if not shorter and found.text() != whole.text():
            wrong.append(content[max(0, cut - 20) : cut])
    assert not wrong


FIXED = "x,y,z\n" + "".join(f"{x:.4f},{y:.4f},{z:.4f}\n" for x, y, z in P)
ENDINGS = {
    "fixed decimals": (FIXED, {}),
    "decimal commas": (FIXED.replace(",", ";").replace(".", ","), {}),
    "quoted": ('x,y,z,name\n0.1,0.2,0.3,"P1"\n0.2,0.3,0.4,"P2"\n', {}),
    "a separator at the end": ("x\ty\tz\t\n0.1\t0.2\t0.3\t\n0.2\t0.3\t0.41\t\n", {}),
    "a matrix": ("1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.3\n0 0 0 1\n", {}),
    "a comment": ("x,y,z\n0.1,0.2,0.3\n0.2,0.3,0.45\n# the end\n", {}),
    "said": ("x,y,z\n0.1,0.2,0.3\n0.2,0.3,0.45\n", {"whole": True}),
}


@pytest.mark.parametrize("how", ENDINGS)
def test_a_whole_file_without_a_last_line_end_is_read(how: str, tmp_path: Path) -> None:
    text, options = ENDINGS[how]
    path = tmp_path / "points.txt"
    path.write_text(text)
    expected = imported(path).text()
    path.write_text(text.rstrip("\n"))
    assert imported(path, **options).text() == expected


def test_what_may_be_cut_off_is_refused_with_a_way_on(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n0.1,0.2,0.3\n0.2,0.3,1.2")
    said = r"points\.csv:3: found '1\.2' at the end of the file, without a line break; .*--whole"
    with pytest.raises(InputError, match=said):
        imported(path)
    path.write_text(FIXED.rstrip("\n")[:-1])
    with pytest.raises(InputError, match=rf"csv:{len(P) + 1}: found .*without a line break"):
        imported(path)
    path.write_text("x,y,z\n0.1,0.2,0.3\n0.2,0.3")
    with pytest.raises(InputError, match=r":3: found a last row of 2 cells; expected 3, as in"):
        imported(path)


INDENTED = "x y z\n" + "".join(f" {x:8.4f} {y:8.4f} {z:8.4f}\n" for x, y, z in P)
MATRICES = "1.00 0.00 0.00 0.10\n0.00 1.00 0.00 0.20\n0.00 0.00 1.00 0.30\n0.00 0.00 0.00 1.00\n"
TRICKY = {
    "blanks with which rows begin": INDENTED + " ",
    "the 1 of a matrix": MATRICES + MATRICES[:-4],
    "END of ENDIF": "DEF a( )\nIF x THEN\nPTP {A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\nEND",
}


@pytest.mark.parametrize("what", TRICKY)
def test_what_looks_like_an_end(what: str, tmp_path: Path) -> None:
    path = tmp_path / ("a.src" if "END" in what else "a.txt")
    path.write_text(TRICKY[what])
    with pytest.raises(InputError, match=r"cut off while it was written .*--whole"):
        imported(path)


PROGRAM = (
    "DEFDAT A\nDECL E6POS P={X 1,Y 2,Z 3,A 0,B 0,C 1}\nDECL E6POS Q={X 1,Y 2,Z 3,A 0,B 0,C 25}\n"
)


def test_a_program_needs_the_end_that_it_has_begun(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text(PROGRAM)
    with pytest.raises(InputError, match=r"found no end of the block 'DEFDAT A'; .*give --whole"):
        imported(path)
    assert len(imported(path, whole=True)) == 2
    path.write_text(PROGRAM + "ENDDAT")
    assert len(imported(path)) == 2
    # Lines of a program alone begin no block.
    path.write_text(PROGRAM.partition("\n")[2].rstrip("\n"))
    assert len(imported(path)) == 2
    path.write_text(PROGRAM.partition("\n")[2].rstrip("5}\n"))
    with pytest.raises(InputError, match=r"a\.dat:2: found .*C 2' at the end of the file"):
        imported(path)


def test_fewer_frames_than_a_file_states_are_refused(tmp_path: Path) -> None:
    sample = SAMPLES["motive"](tmp_path)
    text = sample.path.read_text().replace("Length", "Total Exported Frames,9,Length")
    sample.path.write_text(text)
    with pytest.raises(InputError, match=r"8 frames; expected 9, as the file states; .*--whole"):
        imported(sample.path, **sample.options)
    assert len(imported(sample.path, **sample.options, whole=True)) == 7
