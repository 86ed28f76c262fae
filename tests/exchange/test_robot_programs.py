"""Positions in programs of robot controllers: joints in rad, poses in m, each with its line."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported
from foreign_samples import JOINTS, PROGRAMS, P, R

from suta_calib.errors import InputError


@pytest.mark.parametrize("form", PROGRAMS)
def test_poses(form: str, tmp_path: Path) -> None:
    found = imported(PROGRAMS[form](tmp_path).path, what="poses")
    assert found.form == form
    check(found, tmp_path / "o.csv", R, P)


@pytest.mark.parametrize("form", PROGRAMS)
def test_joints(form: str, tmp_path: Path) -> None:
    """What stands in a comment is no position; a row says in which line it stands."""
    path = PROGRAMS[form](tmp_path).path
    found = imported(path, what="joints", joint_names="a,b,c,d,e,f")
    angles = np.stack([found.columns[name] for name in "abcdef"], axis=1)
    np.testing.assert_allclose(angles, JOINTS, atol=1e-12)
    assert found.columns["line"].tolist() == list(range(3, 19, 2))
    assert "joint_6" in imported(path, what="joints").columns


@pytest.mark.parametrize("form", PROGRAMS)
def test_which_positions_is_asked(form: str, tmp_path: Path) -> None:
    path = PROGRAMS[form](tmp_path).path
    with pytest.raises(InputError, match=r"8 joints and 8 poses; .*--what joints"):
        imported(path)
    with pytest.raises(InputError, match=r"--joint-names: found 2 names; expected 6"):
        imported(path, what="joints", joint_names="a,b")
    path.write_text("MODULE\nDEF a()\nmovej(here)\n")
    with pytest.raises(InputError, match="found no positions; expected positions in"):
        imported(path, form)


# ── As controllers write them ────────────────────────────────────────────────────────────────
UR = """\
def program():
  set_gravity([0.0, 0.0, 9.82])
  set_tcp(p[0.0,0.0,0.15,0.0,0.0,0.0])
  set_target_payload(0.5, [0.0, 0.0, 0.05], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
  global Waypoint_1_p=p[-.1439, -.4356, .2020, -.0012, 3.1162, .0388]
  global Waypoint_1_q=[-1.6, -1.7271, -2.2, -0.8, 1.5951, -0.031]
  movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.39, v=1.04)
  movel(p[.1, .2, .3, 0, 0, 0], a=1.2)
end
"""
ABB = """\
MODULE MainModule
  TASK PERS tooldata pen:=[TRUE,[[89.08,1.02,182.5],[1,0,0,0]],[2,[0,50,88],[1,0,0,0],0,0,0]];
  CONST robtarget p10:=[[10,-350,199],[1,0,0,0],[0,0,0,4],[-101.6,9E+9,9E+9,9E+9,9E+9,9E+9]];
  PROC main()
    MoveL [[301,-138,627],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]], v200, fine, tool0;
  ENDPROC
ENDMODULE
"""
KUKA = """\
&ACCESS RV
DEFDAT Points PUBLIC
DECL BASIS_SUGG_T LAST_BASIS={POINT1[] "P6 ",CP_PARAMS[] "CPDAT1"}
DECL E6POS XP1={X 27.0,Y 1220.2,Z 669.8,A -90.0,B 53.4,C -178.5,S 2,T 35,E1 0.0,E2 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
DECL E6POS XP2={X 40, Y 50, Z 60, A 0, B 90, C 180, S 2, T 1}
ENDDAT
"""


@pytest.mark.parametrize(
    ("name", "text", "what", "names", "first"),
    [
        ("a.script", UR, "poses", ["Waypoint_1_p", ""], -0.1439),
        ("a.script", UR, "joints", ["Waypoint_1_q"], None),
        ("a.mod", ABB, "poses", ["p10", ""], 0.01),
        ("a.dat", KUKA, "poses", ["XP1", "XP2"], 0.027),
    ],
)
def test_positions_have_their_names_and_settings_are_none(
    name: str, text: str, what: str, names: list[str], first: float | None, tmp_path: Path
) -> None:
    """A tool, a payload or what was moved to last is no position, whatever its numbers are."""
    path = tmp_path / name
    path.write_text(text)
    found = imported(path, what=what)
    assert found.columns["name"].tolist() == names
    if first is not None:
        assert found.columns["x"][0] == pytest.approx(first)


def test_a_long_number_takes_no_time(tmp_path: Path) -> None:
    """One way to read it: 19,000 digits would else be read in as many ways."""
    path = tmp_path / "a.mod"
    path.write_text("MODULE a\nCONST jointtarget q:=[[" + "1" * 19_000 + "x\n")
    begin = time.process_time()
    with pytest.raises(InputError, match="no positions"):
        imported(path, "rapid")
    assert time.process_time() - begin < 1.0


def test_an_angle_of_very_many_turns_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.script"
    path.write_text("movel(p[1, 2, 3, 0, 0, 0])\nmovel(p[1, 2, 3, 0, 1e300, 0])\n")
    with pytest.raises(InputError, match=r"a\.script:2: found an angle of 1e\+300 rad"):
        imported(path, what="poses")


# ── External axes ────────────────────────────────────────────────────────────────────────────
TRACK = """\
DEFDAT RUN PUBLIC
DECL E6AXIS XP1={A1 10.0,A2 -80.0,A3 95.0,A4 10.0,A5 -20.0,A6 30.0,E1 0.0,E2 0.0}
DECL E6AXIS XP2={A1 20.0,A2 -70.0,A3 85.0,A4 -10.0,A5 20.0,A6 -30.0,E1 1500.0,E2 0.0}
ENDDAT
"""
SEVEN = """\
MODULE m
CONST jointtarget p1:=[[20,-100,30,0,40,0],[-80,9E9,9E9,9E9,9E9,9E9]];
CONST jointtarget p2:=[[50,-90,40,80,30,10],[-60,9E9,9E9,9E9,9E9,9E9]];
ENDMODULE
"""


def test_an_external_axis_that_moves_is_a_column_in_the_unit_that_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text(TRACK)
    said = r"a\.dat:3: found the external axis E1, 0 to 1500, in mm or degrees; .*E1=mm, E1=deg"
    with pytest.raises(InputError, match=said):
        imported(path)
    with pytest.raises(InputError, match="the external axis E1"):
        imported(path, joint_names="a,b,c,d,e,f,track")  # no joint turns by 1500 degrees
    for options, name in (({}, "E1"), ({"joint_names": "a,b,c,d,e,f,track"}, "track")):
        found = imported(path, external_unit="E1=mm", **options)
        np.testing.assert_allclose(found.columns[name], [0.0, 1.5])
        assert "E2" not in found.columns
    assert any("E1" in note for note in imported(path, external_unit="mm").notes)
    assert "E1" not in imported(path, external_unit="E1=unused").columns
    with pytest.raises(InputError, match="--external-unit: found the axis 'E7'"):
        imported(path, external_unit="E7=mm")


def test_the_seventh_joint_of_an_arm(tmp_path: Path) -> None:
    path = tmp_path / "a.mod"
    path.write_text(SEVEN)
    with pytest.raises(InputError, match=r"a\.mod:2: found the external axis eax_a, -80 to -60"):
        imported(path)
    found = imported(path, joint_names="a,b,c,d,e,f,g")
    np.testing.assert_allclose(found.columns["g"], np.deg2rad([-80, -60]))
    assert "treated as degrees" in found.notes[0]
    assert not imported(path, joint_names="a,b,c,d,e,f,g", external_unit="deg").notes
    with pytest.raises(InputError, match="expected 6 different ones, or 7 with eax_a"):
        imported(path, joint_names="a,b")
    # It may stand at zero, and be in some positions only.
    path.write_text(SEVEN.replace("[-80", "[0").replace("[-60", "[0"))
    assert imported(path, joint_names="a,b,c,d,e,f,g").columns["g"].tolist() == [0.0, 0.0]
    assert "eax_a" not in imported(path).columns
    path.write_text(SEVEN.replace("[-60", "[9E9"))
    with pytest.raises(InputError, match=r":3: found a position without the external axis eax_a"):
        imported(path, external_unit="deg")


def test_poses_say_that_an_external_axis_moved(tmp_path: Path) -> None:
    path = tmp_path / "a.mod"
    path.write_text(ABB)
    assert "eax_a, -101.6 to -101.6, is not used" in imported(path).notes[0]
