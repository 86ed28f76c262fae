"""Artefact files: round trip, every refusal with its place, no other exception for any input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from suta_calib.errors import ArtefactError, SamplesError
from suta_calib.measurements import Artefact, Landmark, Samples, read_artefact, write_artefact
from suta_calib.measurements.artefact import artefact_text
from suta_calib.terms import MeasuredPoses
from suta_calib.terms.landmark import certified_positions


@pytest.fixture(scope="session")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("artefact") / "artefact.yaml"


def artefact(*positions: list[float]) -> Artefact:
    names = "ABCDEFGH"[: len(positions)]
    landmarks = [Landmark(n, np.array(p)) for n, p in zip(names, positions, strict=True)]
    return Artefact("plate", {landmark.name: landmark for landmark in landmarks})


names = st.text(min_size=1, max_size=10).map(str.strip).filter(bool)


@given(
    title=names,
    keys=st.lists(names, min_size=1, max_size=6, unique=True),
    seed=st.integers(0, 2**31),
    seated=st.booleans(),
    sigma=st.floats(0, 1e-3),
)
def test_what_is_written_is_read_back(
    scratch: Path, title: str, keys: list[str], seed: int, seated: bool, sigma: float
) -> None:
    rng = np.random.default_rng(seed)
    landmarks = {
        key: Landmark(
            key,
            rng.normal(size=3),
            Rotation.from_quat(rng.normal(size=4)).as_matrix() if seated else None,
            sigma,
        )
        for key in keys
    }
    write_artefact(scratch, Artefact(title, landmarks))
    read = read_artefact(scratch)
    assert read.name == title
    assert list(read.landmarks) == keys
    for key, written in landmarks.items():
        landmark = read.landmarks[key]
        assert landmark.name == key
        np.testing.assert_allclose(landmark.position, written.position, rtol=0, atol=1e-12)
        assert landmark.sigma == pytest.approx(sigma, abs=1e-12)
        if seated:
            np.testing.assert_allclose(landmark.rotation, written.rotation, atol=1e-10)
        else:
            assert landmark.rotation is None


def test_the_documented_example(tmp_path: Path) -> None:
    path = tmp_path / "artefact.yaml"
    path.write_text(
        "name: steel artefact 1\n"
        "landmarks:\n"
        "  O: {position_mm: [0, 0, 40], rotation_rpy_deg: [180, 0, 30], sigma_mm: 1e-2}\n"
        "  01: {position_mm: [10, 0, 40]}\n",
        encoding="utf-8",
    )
    read = read_artefact(path)
    landmark = read.landmarks["O"]
    assert read.name == "steel artefact 1"
    np.testing.assert_allclose(landmark.position, [0, 0, 0.04])
    expected = Rotation.from_euler("xyz", [180, 0, 30], degrees=True).as_matrix()
    np.testing.assert_allclose(landmark.rotation, expected, atol=1e-15)
    assert landmark.sigma == pytest.approx(1e-5)
    assert list(read.landmarks) == ["O", "01"]
    with pytest.raises(ValueError, match="read-only"):
        landmark.position[0] = 1.0


def test_positions_by_name() -> None:
    plate = artefact([0, 0, 0], [1, 2, 3])
    np.testing.assert_array_equal(plate.position_of("BAB"), [[1, 2, 3], [0, 0, 0], [1, 2, 3]])
    assert plate.position_of([]).shape == (0, 3)
    with pytest.raises(ArtefactError, match=r"'plate': found no landmark 'b'.*mean 'B'"):
        plate.position_of(["A", "b"])


def test_samples_of_unknown_landmarks_are_refused_with_their_row() -> None:
    samples = Samples.from_arrays(
        ["j1"], [[0.0]] * 2, labels={"landmark": ["A", "a"]}, origin=["a.csv:2", "a.csv:3"]
    )
    poses = MeasuredPoses(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), samples)
    certified = certified_positions(poses.take([0]), artefact([1, 2, 3]))
    np.testing.assert_array_equal(certified, [[1, 2, 3]])
    with pytest.raises(SamplesError, match=r"a\.csv:3: found landmark 'a'.*mean 'A'"):
        certified_positions(poses, artefact([0, 0, 0]))


def test_impossible_artefacts_in_memory() -> None:
    with pytest.raises(ArtefactError, match="found no landmarks"):
        artefact()
    with pytest.raises(ArtefactError, match="found 'B' and 'C' at the same place"):
        artefact([0, 0, 0], [0, 1, 0], [0, 1, 0.9e-6])
    assert len(artefact([0, 0, 0], [0, 0, 1.1e-6]).landmarks) == 2


A = "landmarks:\n  A: {position_mm: [0, 0, 0]}\n"
B = A + "  B: "
AT = "position_mm: [1, 0, 0]"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", None, "an empty file"),
        ("- 1", 1, "no keys at the top level"),
        ("name: x\n", None, "landmarks: found no such key"),
        ("landmarks: {}\n", 1, "landmarks: found an empty mapping"),
        ("name: x\nlandmarks:\n", 2, "landmarks: found nothing"),
        ("landmarks: [1]\n", 1, "landmarks: found a list"),
        ("name: 3\n" + A, 1, "name: found 3; expected text; put it in quotes"),
        ("name: \n" + A, 1, "name: found nothing"),
        ("nam: x\n" + A, 1, "nam: found an unknown key; .* did you mean 'name'?"),
        (A + "  A: {position_mm: [1, 0, 0]}\n", 3, "the key 'A' twice"),
        (A + "  ' A': {position_mm: [1, 0, 0]}\n", 1, "landmarks: found an empty or repeated name"),
        (A + "  '': {position_mm: [1, 0, 0]}\n", 1, "landmarks: found an empty or repeated name"),
        (
            A + "  B:\n    sigma_mm: 1\n    position_mm: [0, 0, 0.0009]\n",
            5,
            "landmarks.B.position_mm: found the same position as that of 'A'",
        ),
        (
            B + "{position_mm: [0.07, 0, 0.02]}\n",
            1,
            "landmarks: found all landmarks within 0.07 mm of one another; expected positions "
            "in mm; these look like metres",
        ),
        (B + "3\n", 3, "landmarks.B: found 3; expected a mapping"),
        (B + "{sigma_mm: 1}\n", 3, "landmarks.B.position_mm: found no such key"),
        (B + "{position: [1, 0, 0]}\n", 3, "landmarks.B.position: found a position without"),
        (A + "  B:\n    position_mm: [1, 0]\n", 4, "landmarks.B.position_mm: found 2 values"),
        (B + "{position_mm: 1}\n", 3, "landmarks.B.position_mm: found 1; expected a list"),
        (B + "{position_mm: [1, .nan, 0]}\n", 3, r"B.position_mm\[1\]: found nan"),
        (B + "{position_mm: [1, 0, -.inf]}\n", 3, r"B.position_mm\[2\]: found -inf"),
        (B + "{position_mm: [true, 0, 0]}\n", 3, r"B.position_mm\[0\]: found true"),
        (B + "{position_mm: [a, 0, 0]}\n", 3, r"B.position_mm\[0\]: found 'a'"),
        (B + "{position_mm: [0x10, 0, 0]}\n", 3, "found '0x10'; expected a decimal number"),
        (B + f"{{{AT}, rotation_rpy_deg: [1]}}\n", 3, "B.rotation_rpy_deg: found 1 values"),
        (B + f"{{{AT}, sigma_mm: -0.1}}\n", 3, "B.sigma_mm: found -0.1; expected a non-neg"),
        (B + f"{{{AT}, sigma: 1}}\n", 3, "B.sigma: found an unknown key; .* 'sigma_mm'?"),
    ],
)
def test_refused(tmp_path: Path, text: str, line: int | None, message: str) -> None:
    path = tmp_path / "artefact.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ArtefactError, match=message) as caught:
        read_artefact(path)
    place = str(path) if line is None else f"{path}:{line}: "
    assert str(caught.value).startswith(place)
    assert caught.value.line == line
    assert "\n" not in str(caught.value)


# ── any input: an artefact or an ArtefactError ───────────────────────────────────────────────
def read_or_refuse(path: Path) -> None:
    try:
        read = read_artefact(path)
    except ArtefactError as error:
        assert str(path) in str(error)  # noqa: PT017 (whether it raises depends on the example)
        return
    assert np.isfinite(read.position_of(read.landmarks)).all()


values = st.one_of(st.floats(), st.integers(), st.text(max_size=5), st.none(), st.booleans())
rows = st.dictionaries(
    st.sampled_from(["position_mm", "rotation_rpy_deg", "sigma_mm"]),
    st.one_of(values, st.lists(st.floats(), min_size=3, max_size=3)),
)


@given(landmarks=st.dictionaries(st.text(max_size=3), st.one_of(values, rows)), tail=st.text())
def test_arbitrary_values(scratch: Path, landmarks: dict[str, object], tail: str) -> None:
    # repr is close enough to YAML's flow style to reach every check, and odd enough to break some.
    text = f"landmarks: {landmarks!r}".replace("inf", ".inf").replace("nan", ".nan")
    scratch.write_text(text + "\n" + tail, encoding="utf-8")
    read_or_refuse(scratch)


def test_a_sheet_is_as_long_as_a_ruler_says(tmp_path: Path) -> None:
    """Between its outer landmarks; the ruler is good to 0.2 mm, unless the file says otherwise."""
    text = (
        "grade: printed\nmeasured_mm: [155.2, 200.5]\nlandmarks:\n"
        "  A1: {position_mm: [0, -100, 0]}\n  A2: {position_mm: [80, 50, 0]}\n"
        "  A3: {position_mm: [160, 100, 2]}\n"
    )
    (tmp_path / "sheet.yaml").write_text(text)
    sheet = read_artefact(tmp_path / "sheet.yaml")
    along = sheet.landmarks["A3"].position - sheet.landmarks["A1"].position
    np.testing.assert_allclose(along, [0.1552, 0.2005, 0.002], atol=1e-12)
    assert sheet.length_scale.measured
    assert sheet.length_scale.ppm == pytest.approx(1250)
    assert sheet.stretch == pytest.approx(1.25e-3)
    (tmp_path / "again.yaml").write_text(artefact_text(sheet))
    again = read_artefact(tmp_path / "again.yaml")
    np.testing.assert_allclose(again.landmarks["A2"].position, sheet.landmarks["A2"].position)
    (tmp_path / "sheet.yaml").write_text(f"scale_ppm: 500\n{text}")
    assert read_artefact(tmp_path / "sheet.yaml").length_scale.ppm == pytest.approx(500)
    for wrong in ("[15.5, 20.0]", "[200.5, 155.2]"):
        (tmp_path / "sheet.yaml").write_text(text.replace("[155.2, 200.5]", wrong))
        with pytest.raises(ArtefactError, match=r"measured_mm: found .*about 160 and 200 mm"):
            read_artefact(tmp_path / "sheet.yaml")
