"""What every format promises, whichever it is: asked of the registry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from device_streams import device

from suta_calib.device import FORMATS, Format, decoder_for, read_device
from suta_calib.device.diagnosis import describe_bytes
from suta_calib.device.formats import Sample
from suta_calib.errors import DeviceFileError
from suta_calib.registry import shipped

ANGLES = np.array([[0.0, 1.0, -2.0, 3.0], [0.1, 1.1, -2.1, 3.1], [math.pi, -1.0, 0.5, -0.5]])
NONE = np.zeros(4, dtype=bool)
SHIPPED = shipped(FORMATS)
# Of those that are asked no bytes come by themselves.
SENT = {name: form for name, form in SHIPPED.items() if not form.asked}


def sent(form: Format) -> bytes:
    encoder = form.encoder(device(4, format=form.name))
    values = encoder.values(ANGLES)
    return b"".join(
        encoder.packet(Sample(k, 1000 * k, row, NONE, NONE)) for k, row in enumerate(values)
    )


@pytest.mark.parametrize("form", SHIPPED.values(), ids=SHIPPED)
def test_what_it_encodes_it_decodes(form: Format) -> None:
    spec = device(4, format=form.name)
    # A decoder may need the end of what came before to know where something begins.
    readings = decoder_for(spec).feed(2 * sent(form), 5.0)[-len(ANGLES) :]
    step = math.tau / spec.counts_per_turn
    for reading, angles in zip(readings, ANGLES, strict=True):
        assert np.abs(np.angle(np.exp(1j * (reading.angles - angles)))).max() <= 0.51 * step
        assert not reading.error.any()
    own_clock = [reading.time for reading in readings] != [5.0] * len(ANGLES)
    assert own_clock == form.has_clock


@pytest.mark.parametrize("form", SHIPPED.values(), ids=SHIPPED)
@pytest.mark.parametrize("unit", ["counts", "rad", "deg"])
def test_its_keys_of_device_yaml_are_read_or_refused(form: Format, unit: str, tmp_path) -> None:
    file = tmp_path / "device.yaml"
    file.write_text(f"port: x\nformat: {form.name}\nunit: {unit}\ncounts_per_turn: 4194304\n")
    file.write_text(file.read_text() + "joints: [{name: a}]\n")
    if unit in form.units:
        assert (read_device(file).format, read_device(file).unit) == (form.name, unit)
    else:
        with pytest.raises(DeviceFileError, match="unit"):
            read_device(file)


@pytest.mark.parametrize("form", SENT.values(), ids=SENT)
def test_its_bytes_are_recognised_where_another_is_expected(form: Format) -> None:
    data = 9 * sent(form)
    assert form.recognises(data)
    for other in SHIPPED.values():
        if other is not form:
            assert not other.recognises(data)
            spec = dataclasses.replace(device(4), format=other.name)
            assert f"format: {form.name}" in describe_bytes(data, spec)
    assert not form.recognises(bytes(range(128, 256)))


def test_each_has_the_name_it_is_found_by() -> None:
    assert [form.name for form in FORMATS.values()] == list(FORMATS)
