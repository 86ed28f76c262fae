"""Classes of other packages: found by entry point, or left out in words."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from suta_calib import registry
from suta_calib.errors import SutaCalibWarning
from suta_calib.exchange.option import formats_of
from suta_calib.exchange.reader import Reader
from suta_calib.registry import Group, all_classes, other_classes, shipped
from suta_calib.terms import KINDS, Term

MODULE = """
    from suta_calib.exchange.reader import Reader

    class Nothing(Reader):
        name, summary, example = "nothing", "an empty file", "x.nothing"
        def recognises(self, path, head):
            return False
        def read(self, path, given):
            raise AssertionError

    class Unfinished(Reader):
        name, example = "unfinished", "x"
        def recognises(self, path, head):
            return False

    class Silent(Reader):
        name, example = "silent", "x"
        recognises, read = Nothing.recognises, Nothing.read
"""


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What readers there are beside those of another package, which has these entry points."""

    def found(entry_points: str, group: Group = "readers", module: str = MODULE) -> set[str]:
        name = f"outside_{tmp_path.name}"
        (tmp_path / f"{name}.py").write_text(dedent(module))
        info = tmp_path / "outside-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: outside\nVersion: 1.0\n")
        text = f"[suta_calib.{group}]\n{entry_points.format(here=name)}\n"
        (info / "entry_points.txt").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.setattr(registry, "_found", {})
        return set(all_classes("readers", Reader, "suta_calib.exchange.readers"))

    yield found
    # What was found of it is not to be found again by others.
    formats_of.cache_clear()


def test_a_class_of_another_package_is_found(outside) -> None:
    ours = set(shipped(all_classes("readers", Reader, "suta_calib.exchange.readers")))
    assert outside("nothing = {here}:Nothing") - ours >= {"nothing"}
    assert "nothing" not in shipped(all_classes("readers", Reader, "suta_calib.exchange.readers"))


@pytest.mark.parametrize(
    ("entry_point", "says"),
    [
        ("gone = not_there_at_all:X", r"cannot be loaded \(ModuleNotFoundError: No module"),
        ("gone = {here}:Missing", r"cannot be loaded \(AttributeError: "),
        ("table = {here}:Nothing", "found the name 'table', which is taken"),
        ("other = {here}:Nothing", "calls itself 'nothing'; expected 'other', the name of the ent"),
        ("path = pathlib:Path", "found pathlib:Path; expected a subclass of suta_calib.exchange"),
        ("unfinished = {here}:Unfinished", "does not define read, summary"),
        ("silent = {here}:Silent", "does not define summary"),
    ],
)
def test_what_cannot_be_used_is_left_out_in_words(outside, entry_point: str, says: str) -> None:
    name = entry_point.split()[0]
    ours = set(shipped(all_classes("readers", Reader, "suta_calib.exchange.readers")))
    with pytest.warns(SutaCalibWarning, match=says) as told:
        found = outside(entry_point)
    assert name not in found - ours
    assert ours <= found
    where = f"suta_calib.readers: {name} of the package outside is left out: "
    assert [str(each.message).startswith(where) for each in told] == [True]


def test_a_module_that_ends_the_program_does_not(outside) -> None:
    with pytest.warns(SutaCalibWarning, match="SystemExit: 3"):
        outside("nothing = {here}:Nothing", module="raise SystemExit(3)")


def test_a_module_that_asks_for_its_own_group_is_found(outside) -> None:
    asks = "from suta_calib.exchange import import_formats\nassert 'table' in import_formats()\n"
    assert "nothing" in outside("nothing = {here}:Nothing", module=asks + dedent(MODULE))


def test_a_kind_that_is_called_as_ours_is_refused(outside) -> None:
    outside("plane = {here}:Nothing", group="kinds")
    with pytest.warns(SutaCalibWarning, match="suta_calib.kinds: plane of the package outside"):
        assert "plane" not in other_classes("kinds", Term, ["plane"])
    assert KINDS["plane"].__module__ == "suta_calib.terms.plane"
