from __future__ import annotations

import os
import select
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from suta_calib.emulation import PseudoTerminal
from suta_calib.errors import OutputError


@contextmanager
def opened(port: str) -> Iterator[int]:
    """The other end of a port."""
    file = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        yield file
    finally:
        os.close(file)


def received(file: int, wait: float = 0.05) -> bytes:
    """Everything that arrives until nothing more does."""
    data = b""
    while select.select([file], [], [], wait)[0]:
        piece = os.read(file, 65536)
        if not piece:
            break
        data += piece
    return data


def ended(file: int) -> bool:
    """Whether reading finds the end at once; systems differ in how they say so."""
    try:
        return os.read(file, 10) == b""
    except OSError:
        return True


def test_bytes_arrive_as_they_are_and_none_from_before() -> None:
    everything = bytes(range(256)) * 2
    with PseudoTerminal() as terminal:
        assert not terminal.heard()
        assert not terminal.write(b"nobody hears this")
        with opened(terminal.port) as file:
            assert terminal.heard()
            assert terminal.write(everything)
            assert received(file) == everything


def test_the_next_reader_does_not_get_what_the_last_one_left() -> None:
    with PseudoTerminal() as terminal:
        with opened(terminal.port):
            assert terminal.write(b"left unread")
        assert not terminal.heard()
        with opened(terminal.port) as file:
            assert received(file) == b""
            assert terminal.write(b"new")
            assert received(file) == b"new"


def test_a_reader_that_lags_misses_whole_packets_only() -> None:
    packets = [b"<%06d>" % k for k in range(20000)]
    with PseudoTerminal() as terminal, opened(terminal.port) as file:
        sent = [packet for packet in packets if terminal.write(packet)]
        assert len(sent) < len(packets), "the buffer is finite"
        data = received(file)
        assert terminal.write(b"<again>")
        data += received(file)
        # What was begun when the buffer ran full is finished first.
        assert data == b"".join([*sent, b"<again>"])


def test_what_readers_write_does_no_harm() -> None:
    with PseudoTerminal() as terminal, opened(terminal.port) as file:
        for _ in range(50):
            os.write(file, b"x" * 500)
            assert terminal.heard()
        assert terminal.write(b"fine")
        assert received(file) == b"fine", "and no echo"


def test_a_port_that_vanishes_ends_its_readers_and_comes_back(tmp_path: Path) -> None:
    link = tmp_path / "port"
    with PseudoTerminal(link) as terminal:
        assert str(link.readlink()) == terminal.name
        with opened(str(link)) as file:
            terminal.close()
            assert not link.is_symlink()
            assert not terminal.write(b"gone")
            assert ended(file)
        terminal.open()
        with opened(str(link)) as file:
            assert terminal.write(b"back")
            assert received(file) == b"back"
    assert not link.is_symlink()


def test_an_old_link_is_replaced_a_file_is_not(tmp_path: Path) -> None:
    link = tmp_path / "port"
    link.symlink_to("/dev/pts/no such port")
    with PseudoTerminal(link) as terminal:
        assert str(link.readlink()) == terminal.name
    link.write_text("a file")
    with pytest.raises(OutputError, match="not a link"):
        PseudoTerminal(link)
    assert link.read_text() == "a file"
    with pytest.raises(OutputError, match="link not created"):
        PseudoTerminal(tmp_path / "nowhere" / "port")


def test_a_link_that_somebody_else_has_taken_over_stays(tmp_path: Path) -> None:
    link = tmp_path / "port"
    with PseudoTerminal(link):
        link.unlink()
        link.symlink_to("/dev/null")
    assert str(link.readlink()) == "/dev/null"


def test_what_nobody_has_read_yet_is_counted() -> None:
    with PseudoTerminal() as terminal:
        reader = os.open(terminal.name, os.O_RDONLY | os.O_NOCTTY)
        assert terminal.unread == 0
        assert terminal.write(b"x" * 100)
        end = time.monotonic() + 30
        while terminal.unread < 100:  # the system hands it over when it comes to that
            assert time.monotonic() < end
            time.sleep(0.001)
        os.read(reader, 60)
        assert terminal.unread == 40
        # To look is not to listen, nor to hang up.
        assert terminal.heard()
        os.close(reader)
        assert not terminal.heard()


def test_looking_for_readers_is_cheap() -> None:
    with PseudoTerminal() as terminal:
        began = time.process_time()
        for _ in range(1000):
            terminal.heard()
        assert time.process_time() - began < 0.5
