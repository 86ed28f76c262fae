"""Poses to OpenIGTLink clients, UDP and files: whole, in order, and never waiting for anybody."""

from __future__ import annotations

import errno
import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pyigtl
import pytest
from simulated import SUTA_URDF
from tracking_scene import poses

from suta_calib.errors import InputError, OutputError
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.igtl import SEND_BUFFER, IgtlPublisher
from suta_calib.tracking.publisher import UdpPublisher
from suta_calib.tracking.recording import CsvRecorder, ParquetRecorder
from suta_calib.tracking.tracker import TrackedPose
from suta_calib.tracking.trajectory import read_trajectory

LOCAL = "127.0.0.1"
JOINTS = [f"joint_{k}" for k in range(1, 7)]
PATIENCE_S = 10.0


class Everything(dict[str, Any]):
    """Where pyigtl's client puts messages; it would keep only the latest of a device."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[Any] = []

    def __setitem__(self, name: str, message: Any) -> None:
        self.messages.append(message)


class Client:
    """A real OpenIGTLink client that keeps every message."""

    def __init__(self, port: int) -> None:
        self._client = pyigtl.OpenIGTLinkClient(LOCAL, port, start_now=False)
        self.seen = Everything()
        self._client.incoming_messages = self.seen
        self._client.start()

    @property
    def messages(self) -> list[Any]:
        return self.seen.messages

    def has(self, count: int) -> bool:
        """Whether so many messages come in the end."""
        return eventually(lambda: len(self.messages) == count)


@contextmanager
def connected(publisher: IgtlPublisher) -> Iterator[Client]:
    """A client more than before, for as long as the block lasts."""
    more = clients(publisher) + 1
    client = Client(publisher.port)
    try:
        assert eventually(lambda: clients(publisher) == more)
        yield client
    finally:
        client._client.stop()


def eventually(condition: Callable[[], object]) -> bool:
    """Whether it comes true before patience is over."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


def publish(publisher: IgtlPublisher, each: list[TrackedPose], pause: float = 2e-4) -> float:
    """The longest that one took, s."""
    longest = 0.0
    for pose in each:
        began = time.perf_counter()
        publisher.publish(pose)
        publisher.flush()
        longest = max(longest, time.perf_counter() - began)
        time.sleep(pause)
    return longest


@pytest.fixture
def igtl():
    with IgtlPublisher(0, "StylusTip", LOCAL) as publisher:
        yield publisher


def matrices(messages: list[Any]) -> np.ndarray:
    return np.array([message.matrix for message in messages])


def expected(each: list[TrackedPose]) -> np.ndarray:
    found = np.tile(np.eye(4), (len(each), 1, 1))
    for matrix, pose in zip(found, each, strict=True):
        matrix[:3, :3], matrix[:3, 3] = pose.rotation, 1e3 * pose.position
    return found


def clients(publisher: IgtlPublisher) -> int:
    return int(publisher.statistics()["clients"])


class Sensor(pyigtl.messages.MessageBase):
    """SENSOR of OpenIGTLink 2 as its specification has it; pyigtl knows none."""

    def __init__(self) -> None:
        super().__init__()
        self._message_type = "SENSOR"

    def _unpack_content(self, content: bytes) -> None:
        count, self.status, self.unit = struct.unpack(">BBQ", content[:10])
        self.data = struct.unpack(f">{count}d", content[10:])


def certain(count: int, invalid: tuple[int, ...] = ()) -> list[TrackedPose]:
    """Poses with standard deviations, each another."""
    random = np.random.default_rng(1)
    return [
        replace(pose, std=random.uniform(1e-5, 1e-3, 3), turn_std=random.uniform(1e-5, 1e-2, 3))
        for pose in poses(count, invalid)
    ]


@pytest.mark.parametrize("known", [False, True])
def test_a_real_client_receives_every_pose_in_millimetres(igtl: IgtlPublisher, known: bool):
    """Also one that knows no SENSOR, where standard deviations are known."""
    each = certain(300, invalid=(7, 8)) if known else poses(300, invalid=(7, 8))
    with connected(igtl) as client:
        publish(igtl, each)
        assert client.has(298)
    valid = [pose for pose in each if pose.valid]
    np.testing.assert_allclose(matrices(client.messages), expected(valid), atol=1e-4)
    first = client.messages[0]
    assert (first.message_type, first.device_name) == ("TRANSFORM", "StylusTip")
    assert abs(first.timestamp - valid[0].host_time) < 1e-5
    assert igtl.statistics()["invalid"] == 2


def test_standard_deviations_follow_each_transform(
    igtl: IgtlPublisher, monkeypatch: pytest.MonkeyPatch
):
    each = certain(50)
    known = pyigtl.messages.message_type_to_class_constructor
    monkeypatch.setitem(known, "SENSOR", Sensor)
    with connected(igtl) as client:
        publish(igtl, each)
        assert client.has(100)
    transforms, sensors = client.messages[::2], client.messages[1::2]
    np.testing.assert_allclose(matrices(transforms), expected(each), atol=1e-4)
    for transform, sensor, pose in zip(transforms, sensors, each, strict=True):
        assert (sensor.message_type, sensor.device_name) == ("SENSOR", "StylusTipStd")
        assert sensor.timestamp == transform.timestamp
        wanted = [*(1e3 * pose.std), *np.degrees(pose.turn_std)]
        np.testing.assert_allclose(sensor.data, wanted, rtol=1e-12)
        assert (sensor.status, sensor.unit) == (0, 0)
    assert igtl.published == 50


@pytest.mark.parametrize(
    ("name", "std"), [("Tip", "TipStd"), ("A" * 17, "A" * 17 + "Std"), ("B" * 20, "B" * 17 + "Std")]
)
def test_names_of_standard_deviations_fit_the_protocol(name: str, std: str):
    with IgtlPublisher(0, name) as publisher:
        assert publisher._std_name == std


def test_a_client_that_comes_late_does_not_disturb_the_first(igtl: IgtlPublisher):
    each = poses(600)
    with connected(igtl) as first:
        publish(igtl, each[:300])
        with connected(igtl) as second:
            publish(igtl, each[300:])
            assert first.has(600)
            assert second.has(300)
        assert eventually(lambda: clients(igtl) == 1)
        publish(igtl, each[:50])
        assert first.has(650)
    np.testing.assert_allclose(matrices(second.messages), expected(each[300:]), atol=1e-4)
    assert igtl.dropped == 0


def test_poses_go_nowhere_while_nobody_listens(igtl: IgtlPublisher):
    publish(igtl, poses(100), pause=0)
    assert (igtl.published, igtl.dropped) == (0, 0)


def test_a_client_that_stops_reading_slows_nobody_and_gets_whole_messages(igtl: IgtlPublisher):
    one, last = poses(2)
    with connected(igtl) as reader, socket.create_connection((LOCAL, igtl.port)) as stalled:
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        assert eventually(lambda: clients(igtl) == 2)
        sent = 0
        longest = 0.0
        while igtl.dropped < 200:
            longest = max(longest, publish(igtl, [one] * 50, pause=0))
            sent += 50
            assert sent < 100 * SEND_BUFFER // 106, "the kernel takes everything"
            assert reader.has(sent)
        # A blocking send would have waited for ever.
        assert longest < PATIENCE_S
        stalled.settimeout(0.05)
        received = bytearray()

        def caught_up() -> bool:
            publish(igtl, [last], pause=0)
            with suppress(TimeoutError):
                received.extend(stalled.recv(1 << 16))
            return len(received) % 106 == 0 and received[-48:] != received[58:106]

        assert eventually(caught_up)
    assert len(received) % 106 == 0
    stamps = {bytes(received[at : at + 12]) for at in range(0, len(received), 106)}
    assert stamps == {b"\x00\x01TRANSFORM\x00"}
    assert eventually(lambda: clients(igtl) == 0)


def test_poses_that_come_together_are_sent_together(igtl: IgtlPublisher):
    with connected(igtl) as client:
        for pose in poses(5):
            igtl.publish(pose)
        assert igtl.published == 0
        igtl.flush()
        igtl.flush()
        assert igtl.published == 5
        assert client.has(5)


def test_nobody_else_can_read_unless_it_is_said():
    with IgtlPublisher(0) as own, IgtlPublisher(0, host="0.0.0.0") as everybodys:
        assert own.public == ""
        assert everybodys.public == f"0.0.0.0:{everybodys.port}"


def test_more_clients_than_are_served_are_hung_up_on():
    with ExitStack() as stack:
        igtl = stack.enter_context(IgtlPublisher(0, most_clients=2))
        address = LOCAL, igtl.port
        first, _ = (stack.enter_context(socket.create_connection(address)) for _ in range(2))
        assert eventually(lambda: clients(igtl) == 2)
        third = stack.enter_context(socket.create_connection(address))
        third.settimeout(PATIENCE_S)
        assert third.recv(1) == b""
        assert clients(igtl) == 2
        first.close()
        assert eventually(lambda: clients(igtl) == 1)
        stack.enter_context(socket.create_connection(address))
        assert eventually(lambda: clients(igtl) == 2)


def test_a_client_that_takes_nothing_for_too_long_is_hung_up_on():
    with IgtlPublisher(0, patience=0.05) as igtl, socket.create_connection((LOCAL, igtl.port)):
        assert eventually(lambda: clients(igtl) == 1)
        # Nothing is sent for longer than that: it has nothing to take, and may stay.
        time.sleep(0.1)
        publish(igtl, poses(1))
        assert clients(igtl) == 1
        pose = poses(1) * 50

        def hung_up() -> bool:
            publish(igtl, pose, pause=0)
            return clients(igtl) == 0

        assert eventually(hung_up)


def test_out_of_file_descriptors_it_pauses_and_goes_on(monkeypatch: pytest.MonkeyPatch):
    asked = []

    def none_left(_: socket.socket) -> None:
        asked.append(time.perf_counter())
        raise OSError(errno.EMFILE, "Too many open files")

    with IgtlPublisher(0) as igtl:
        with monkeypatch.context() as patch:
            patch.setattr(socket.socket, "accept", none_left)
            client = socket.create_connection((LOCAL, igtl.port))
            assert eventually(lambda: len(asked) == 3)
        assert min(np.diff(asked)) > 0.4
        with client:
            assert eventually(lambda: clients(igtl) == 1)


def test_what_clients_say_is_ignored(igtl: IgtlPublisher):
    with socket.create_connection((LOCAL, igtl.port)) as client:
        client.sendall(bytes(range(256)) * 100)
        assert eventually(lambda: clients(igtl) == 1)
        publish(igtl, poses(1))
        assert len(client.recv(200)) == 106


def test_a_port_in_use_is_one_clear_error(igtl: IgtlPublisher):
    with pytest.raises(OutputError, match=f"port {igtl.port} .* in use.* choose another"):
        IgtlPublisher(igtl.port, host=LOCAL)


@pytest.mark.parametrize("name", ["", "x" * 21, "Spitze µ", "a\nb"])
def test_names_that_do_not_fit_the_header_are_refused(name: str):
    with pytest.raises(InputError, match="1 to 20 ASCII characters"):
        IgtlPublisher(0, name, LOCAL)


def test_udp_datagrams_are_json_in_metres():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind((LOCAL, 0))
        receiver.settimeout(5)
        each = poses(3, invalid=(1,))
        with UdpPublisher(LOCAL, receiver.getsockname()[1]) as publisher:
            for pose in each:
                publisher.publish(pose)
            found = [json.loads(receiver.recv(4096)) for _ in each]
        assert publisher.published == 3
    assert [f["valid"] for f in found] == [True, False, True]
    assert (found[1]["position"], found[1]["errors"]) == (None, ["joint_3"])
    for pose, datagram in zip(each[::2], found[::2], strict=True):
        np.testing.assert_allclose(datagram["position"], pose.position)
        np.testing.assert_allclose(datagram["quaternion"], pose.quaternion)
        assert (datagram["sequence"], datagram["time"]) == (pose.sequence, pose.time)
        assert datagram["std"] is None
        assert datagram["warnings"] == ["joint_2"]


def test_udp_without_a_listener_goes_on():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind((LOCAL, 0))
        port = gone.getsockname()[1]
    with UdpPublisher(LOCAL, port) as publisher:
        for pose in poses(20):
            publisher.publish(pose)
    assert publisher.published + publisher.dropped == 20


def test_an_unknown_host_is_one_clear_error():
    with pytest.raises(InputError, match=r"--udp: found 'no\.such\.host\.invalid'"):
        UdpPublisher("no.such.host.invalid", 1)


def test_csv_has_a_row_for_every_pose(tmp_path: Path):
    each = poses(200, invalid=(5,))
    with CsvRecorder(tmp_path / "log.csv", JOINTS) as recorder:
        for pose in each:
            recorder.publish(pose)
        assert eventually(lambda: recorder.part.stat().st_size > 20_000), "written as it comes"
        assert not recorder.path.exists()
    assert [file.name for file in tmp_path.iterdir()] == ["log.csv"]
    table = read_csv_table(tmp_path / "log.csv")
    assert [int(s) for s in table.columns["sequence"]] == list(range(200))
    assert table.columns["valid"][4:7] == ("1", "0", "1")
    assert table.columns["flags"][4:6] == ("joint_2:warning", "joint_3:error joint_2:warning")
    assert table.columns["x"][5] == ""
    found = read_trajectory(tmp_path / "log.csv", ArmModel.from_urdf(SUTA_URDF, "tip"))
    valid = [pose for pose in each if pose.valid]
    np.testing.assert_allclose(found.position, [p.position for p in valid], atol=1e-9)
    np.testing.assert_allclose(found.rotation, [p.rotation for p in valid], atol=1e-8)
    np.testing.assert_allclose(found.angles, [p.angles for p in valid], atol=1e-9)


def test_parquet_has_the_same(tmp_path: Path):
    each = poses(50, invalid=(5,))
    with ParquetRecorder(tmp_path / "log.parquet", JOINTS) as recorder:
        for pose in each:
            recorder.publish(pose)
    table = pyarrow.parquet.read_table(tmp_path / "log.parquet").to_pydict()
    assert table["sequence"] == list(range(50))
    assert table["valid"] == [pose.valid for pose in each]
    assert (table["x"][5], table["std_x"][0]) == (None, None)
    assert table["y"][6] == each[6].position[1]
    assert table["joint_4"][5] == each[5].angles[3]


@pytest.mark.parametrize("recorder", [CsvRecorder, ParquetRecorder])
def test_without_a_pose_there_is_no_file_and_an_old_one_stays(tmp_path: Path, recorder: Any):
    path = tmp_path / "log"
    path.write_text("earlier")
    with recorder(path, JOINTS):
        pass
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_told_and_what_was_written_is_left(tmp_path: Path):
    each = poses(3)
    recorder = CsvRecorder(tmp_path / "log.csv", JOINTS)
    recorder.publish(each[0])
    assert eventually(lambda: recorder.part.stat().st_size > 300)
    recorder._file.close()
    recorder._file = Path("/dev/full").open("w")  # noqa: SIM115 (the recorder's own)
    recorder.publish(each[1])
    assert eventually(lambda: recorder._failure is not None)
    with pytest.raises(OutputError, match=r"No space left.*log\.csv\.part"):
        recorder.publish(each[2])
    with pytest.raises(OutputError, match="incomplete"):
        recorder.close()
    assert recorder.part.exists()
    with pytest.raises(OSError, match="No space left"):
        recorder._file.close()


def test_a_file_that_cannot_be_created_is_one_clear_error(tmp_path: Path):
    with pytest.raises(OutputError, match="No such file or directory"):
        CsvRecorder(tmp_path / "nowhere" / "log.csv", JOINTS)
    with pytest.raises(OutputError, match="found a folder"):
        CsvRecorder(tmp_path, JOINTS)
