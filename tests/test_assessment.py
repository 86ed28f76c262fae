"""How far an answer may be trusted, in a line."""

from __future__ import annotations

from pathlib import Path

from suta_calib.assessment import Assessment
from suta_calib.report.comparison import plain


def test_its_repr_is_a_line_however_much_it_has_to_say() -> None:
    assert repr(Assessment("good")) == "<Assessment: good>"
    note = "Something must be known. " * 20
    care = Assessment.of("the tip is known to ± 0.1 mm", care=[note, note])
    assert repr(care) == "<Assessment: care; the tip is known to ± 0.1 mm; 2 notes>"
    assert repr([Assessment.of(bad=[note])]) == "[<Assessment: bad; 1 note>]"


def test_a_path_is_shown_plain_where_it_is_the_same_file(tmp_path: Path) -> None:
    (tmp_path / "rehearsal").mkdir()
    arm = tmp_path / "my_arm.urdf"
    arm.touch()
    assert plain(tmp_path / "rehearsal" / ".." / "my_arm.urdf") == arm
    # What comes after a link is in the folder that it leads to.
    elsewhere = tmp_path / "else" / "where"
    elsewhere.mkdir(parents=True)
    (tmp_path / "else" / "my_arm.urdf").touch()
    (tmp_path / "link").symlink_to(elsewhere)
    linked = tmp_path / "link" / ".." / "my_arm.urdf"
    assert plain(linked) == linked
