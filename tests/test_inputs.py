"""Files, pipes and devices are read up to a bound, and none is waited for."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from suta_calib import inputs
from suta_calib.errors import InputError
from suta_calib.inputs import read_input

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inputs, "PATIENCE", 0.05)


def test_a_file_is_read_up_to_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc" * 1000)
    assert read_input(path) == path.read_bytes()
    with pytest.raises(OSError, match="more than 0 MB"):
        read_input(path, 2999)
    with path.open("wb") as file:
        file.truncate(inputs.MOST_OF_FILE + 1)  # takes no room
    with pytest.raises(OSError, match="more than 1000 MB"):
        read_input(path)


def test_a_pipe_is_read_while_somebody_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(OSError, match=r"nothing comes from this pipe or device for 0.05 s"):
        read_input(path)
    monkeypatch.setattr(inputs, "PATIENCE", 20.0)
    content = bytes(range(1, 256)) * 2000
    writer = threading.Thread(target=path.write_bytes, args=(content,))
    writer.start()
    assert read_input(path) == content
    writer.join()


def test_a_device_that_never_ends() -> None:
    for name, says in (("/dev/zero", None), ("/dev/urandom", "more than 1 MB")):
        if not Path(name).exists():
            pytest.skip(f"no {name}")
        if says is None:
            assert not read_input(Path(name)).strip(b"\0")
        else:
            with pytest.raises(OSError, match=says):
                read_input(Path(name), 1_000_000)


def test_a_message_shows_part_of_what_is_long() -> None:
    said = str(InputError("'" + "9" * 5000 + "x'", "a number", file="a.csv", line=3))
    assert said == f"a.csv:3: found '{'9' * 39}…; expected a number"
    path = "/".join(["folder"] * 40)
    assert path in str(InputError(f"no file {path}"))
    many = ", ".join(f"column_{k}" for k in range(10_000))
    assert len(str(InputError(f"only the columns {many}", "x"))) < 1600
