"""``suta-calib import`` end to end: what is written and shown, and what leaves nothing behind."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_job import answer, cli, printed, refused
from foreign_samples import KEPT, SAMPLES, P

from suta_calib.exchange import import_formats
from suta_calib.measurements import read_csv_table


def test_a_poses_csv_is_written_and_told(tmp_path: Path) -> None:
    path = SAMPLES["motive"](tmp_path).path
    out = tmp_path / "poses.csv"
    told = answer("import", path, "--body", "probe", "--out", out)
    assert (told["format"], told["rows"], told["dropped"]) == ("motive", len(KEPT), 1)
    assert told["file"] == str(out)
    assert told["verdict"]["usable"]
    table = read_csv_table(out)
    assert [each["name"] for each in told["columns"]] == list(table.columns)
    assert told["columns"][1]["least"] == pytest.approx(P[KEPT, 0].min(), abs=1e-9)


def test_what_was_imported_is_what_other_commands_read(tmp_path: Path) -> None:
    """From a tracker's file to the tip of a pointer."""
    from pose_scenes import pivot_numbers

    numbers = pivot_numbers(["left"] * 40)
    rows = [[*row[:3] * 1e3, row[6], *row[3:6]] for row in numbers]
    text = "\n".join(";".join(repr(float(v)).replace(".", ",") for v in row) for row in rows)
    path = tmp_path / "stylus.txt"
    path.write_text("Tx;Ty;Tz;Q0;Qx;Qy;Qz\n" + text + "\n")
    out = tmp_path / "poses.csv"
    assert cli("import", path, "--unit", "mm", "--out", out) == 0
    assert json.loads(printed("pivot", out, "--json"))["rms_mm"] < 1.0


def test_a_file_of_options(tmp_path: Path) -> None:
    path = tmp_path / "joints.txt"
    path.write_text("90 2048 P1\n45 1024 P1\n")
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("columns: {1: joint_1, 2: joint_2, 3: placement}\nunit: deg\nheader: no\n")
    out = tmp_path / "samples.csv"
    assert cli("import", path, "--mapping", mapping, "--out", out) == 0
    table = read_csv_table(out)
    assert table.numbers("joint_1").tolist() == pytest.approx([1.5707963267948966, 0.7853981633974])
    assert table.labels("placement").tolist() == ["P1", "P1"]


def test_every_format_is_listed_with_an_example() -> None:
    told = {each["name"]: each for each in answer("import", "--list")["formats"]}
    assert set(told) == set(import_formats())


REFUSED = {
    "nothing": ((), "found no SOURCE"),
    "5,000 digits": (("{table}", "--skip", "9" * 5000), f"--skip: found '{'9' * 39}…; expected"),
    "a column of 5,000 digits": (("{table}", "--columns", "9" * 5000 + "=x"), "no column '99"),
    "a guess": (("{table}", "--columns", "9=x"), "no column '9'"),
    "another format's option": (
        ("{table}", "--seconds", "2"),
        "taken for table, which has no --seconds",
    ),
    "an unknown format": (("{table}", "--format", "motiv"), "did you mean 'motive'"),
    "itself": (("{table}", "--out", "{table}"), "an input of the same command"),
    "a folder": (("{folder}",), "a folder of an unknown format"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused(what: str, tmp_path: Path) -> None:
    words, says = REFUSED[what]
    path = SAMPLES["table"](tmp_path).path
    before = path.read_bytes()
    out = () if "--out" in words else ("--out", tmp_path / "out.csv")
    given = [word.format(table=path, folder=tmp_path) for word in words]
    err = refused("import", *given, *out)
    assert says in err
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == before
