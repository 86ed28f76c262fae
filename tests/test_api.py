"""One call from Python: arms and observations without files, and one judged answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from suta_calib import ArmModel, InputError
from suta_calib.errors import UrdfError


def test_an_arm_is_read_from_the_text_of_a_urdf(suta_urdf: Path, tmp_path: Path) -> None:
    text = suta_urdf.read_text(encoding="utf-8")
    from_file = ArmModel.from_urdf(suta_urdf, "tip")
    q = np.full((1, len(from_file.joints)), 0.3)
    for given in (text, f"\ufeff{text}", f"\n  {text}"):
        arm = ArmModel.from_urdf(given, tip="tip")
        np.testing.assert_array_equal(arm.forward(q)[1], from_file.forward(q)[1])
        arm.write_urdf(tmp_path / "arm.urdf", {"joint_4.z": 0.58})
        from_file.write_urdf(tmp_path / "again.urdf", {"joint_4.z": 0.58})
        assert (tmp_path / "arm.urdf").read_bytes() == (tmp_path / "again.urdf").read_bytes()


def test_text_is_in_the_encoding_that_it_declares(suta_urdf: Path) -> None:
    text = suta_urdf.read_text(encoding="utf-8").replace('"tip"', '"Spitze_ä"')
    text = f'<?xml version="1.0" encoding="iso-8859-1"?>\n{text[text.index("<robot") :]}'
    assert "Spitze_ä".encode("latin-1") in ArmModel.from_urdf(text, "Spitze_ä").urdf[1]
    with pytest.raises(UrdfError, match="text of a URDF: found text that cannot be encoded"):
        ArmModel.from_urdf(text.replace("ä", "漢"), "Spitze_漢")


@pytest.mark.parametrize(
    ("given", "tip", "said"),
    [
        ("<robot", "tip", "the text of a URDF:1: found text that is not XML"),
        ("<robot name='a'></robot>", "tip", "the text of a URDF:1: found no <joint> in <robot>"),
        ("<sdf/>", "tip", "the text of a URDF:1: found the root element <sdf>"),
        ("no_such.urdf", "tip", "no_such.urdf: found no such file"),
        (b"<robot/>", "tip", "urdf: found bytes; expected the path or the text of a URDF"),
        (None, "tip", "urdf: found NoneType; expected the path or the text of a URDF"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_named(given: str, tip: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        ArmModel.from_urdf(given, tip)
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize("tip", ["tool", None, 7])
def test_a_tip_that_is_not_there_is_named(suta_urdf: Path, tip: str) -> None:
    with pytest.raises(UrdfError, match=r"the text of a URDF: tip: found '?(tool|None|7)"):
        ArmModel.from_urdf(suta_urdf.read_text(encoding="utf-8"), tip)
