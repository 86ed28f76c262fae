"""Objects draw themselves: what is drawn is what was computed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from report_scenes import make_job

from suta_calib import Accuracy, ArmModel, Samples, observe
from suta_calib.errors import JobError, SamplesError
from suta_calib.job.calibration import Calibration
from suta_calib.plotting.scene import Arrows, PlacedPoints, drawn_rows, magnification
from suta_calib.trust.tip import tip_displacements
from suta_calib.units import mm, shown

Q = np.array([0.3, -0.2, 0.4, 0.1, -0.5, 0.2])


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Calibration:
    return make_job(tmp_path_factory.mktemp("job"), suta_urdf).run()


@pytest.fixture(autouse=True)
def _no_window() -> Iterator[None]:
    mpl.use("Agg")
    yield
    pyplot.close("all")


def lines(axes: object) -> dict[str, np.ndarray]:
    """Places of the lines of three-dimensional axes, by label, (n, 3)."""
    return {each.get_label(): np.array(each.get_data_3d()).T for each in axes.lines}  # type: ignore[attr-defined]


def test_an_arm_is_drawn_where_its_kinematics_have_it(suta_urdf: Path) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    drawn = lines(arm.plot(Q))
    links = drawn[arm.chain.robot]
    np.testing.assert_allclose(links[-1], mm(arm.forward(Q)[1]), atol=1e-9)
    np.testing.assert_allclose(drawn["tip"][0], links[-1])
    # Turning a joint moves what is beyond it, about its axis, and nothing before it.
    skeleton = arm.skeleton(Q)
    for k in range(len(Q)):
        step = 1e-6 * np.eye(len(Q))[k]
        moved = (arm.skeleton(Q + step).points - arm.skeleton(Q - step).points) / 2e-6
        lever = skeleton.points - skeleton.joints[k]
        np.testing.assert_allclose(
            moved[k + 2 :], np.cross(skeleton.axes[k], lever)[k + 2 :], atol=1e-6
        )
        np.testing.assert_allclose(moved[: k + 2], 0.0, atol=1e-9)


def test_plots_use_the_axes_they_are_given(suta_urdf: Path, result: Calibration) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    axes = pyplot.figure().add_subplot(projection="3d")
    assert arm.plot(ax=axes) is axes
    assert result.plot(ax=axes) is axes
    flat = pyplot.figure().add_subplot()
    assert result.solution.plot_residuals(flat) is flat
    assert observe(result.solution.problem).plot(flat) is flat
    figure = pyplot.figure()
    assert result.solution.plot_parameters(figure) is figure
    with pytest.raises(ValueError, match="expected '3d'"):
        arm.plot(ax=flat)


def test_samples_are_drawn_by_joint_name_in_any_order(result: Calibration) -> None:
    arm, samples = result.job.arm, result.job.observations[0].poses.samples
    drawn = lines(samples.plot(arm))["tip in the samples"]
    np.testing.assert_allclose(drawn, mm(arm.forward(samples.q)[1]))
    swapped = Samples.from_arrays(samples.joints[::-1], samples.q[:, ::-1])
    np.testing.assert_allclose(lines(swapped.plot(arm))["tip in the samples"], drawn)
    with pytest.raises(SamplesError, match="joint_1"):
        Samples.from_arrays(("a", "b"), np.zeros((2, 2))).plot(arm)


def test_displacements_of_the_tip_are_the_errors(result: Calibration) -> None:
    """Of whatever is a vector, the length is the error that the report tells."""
    accuracy, values = result.accuracy, result.solution.values
    looked_at = 0
    for each in accuracy.calibration:
        block = each.blocks[0]
        if block.residual_after.shape[1] != 3 or block.rows.shape[1] != 1:
            continue
        _, found = tip_displacements(each.term, values)
        np.testing.assert_allclose(
            np.linalg.norm(found[block.rows[:, 0]], axis=1), block.after, rtol=1e-5, atol=1e-9
        )
        looked_at += 1
    assert looked_at


@pytest.mark.parametrize("data", ["calibration", "validation"])
def test_errors_are_magnified_and_the_legend_says_how_much(result: Calibration, data: str) -> None:
    scene = result.scene(data)  # type: ignore[arg-type]
    before, after = (part for part in scene.parts if isinstance(part, Arrows))
    assert before.factor == after.factor > 1
    np.testing.assert_allclose(after.ends - after.points, after.factor * after.vectors)
    axes = result.plot(data)  # type: ignore[arg-type]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert f"error after, × {after.factor:g}" in labels
    assert np.linalg.norm(after.vectors) < np.linalg.norm(before.vectors)


def test_places_outside_are_drawn_with_their_labels(result: Calibration) -> None:
    scene = result.scene("calibration")
    places = [
        part for part in scene.parts if isinstance(part, PlacedPoints) and part.look == "place"
    ]
    values = result.solution.values
    for part in places:
        assert len(part.labels) == len(part.points)
    points = {
        label: at for part in places for label, at in zip(part.labels, part.points, strict=True)
    }
    for label, at in points.items():
        owner = f"fixed_point[{label}]"
        if f"{owner}.x" in values:
            np.testing.assert_allclose(at, [values[f"{owner}.{k}"] for k in "xyz"])
    assert points


def test_a_job_without_held_out_data_is_told_so(tmp_path: Path, result: Calibration) -> None:
    without = replace(result, job=replace(result.job, validation=()))
    with pytest.raises(JobError, match="no validation data"):
        without.scene("validation")
    assert without.scene().parts


def test_changes_are_drawn_in_the_units_of_the_reader(result: Calibration) -> None:
    figure = result.solution.plot_parameters()
    changes = result.solution.changes
    for axes in figure.axes:
        unit = "m" if axes.get_xlabel().endswith("mm") else "rad"
        drawn = np.concatenate([line.get_xdata() for line in axes.lines])
        for each in (change for change in changes if change.unit == unit):
            assert np.isclose(drawn, shown(each.change, unit)).any()
    assert {axes.get_xlabel().split()[-1] for axes in figure.axes} == {"mm", "deg"}


def test_residuals_have_the_rms_of_the_report(result: Calibration) -> None:
    axes = result.solution.plot_residuals()
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    rms = Accuracy.overall(result.accuracy.calibration, "after").rms
    assert any(text.startswith("RMS after") and f"{mm(rms):.3g}" in text for text in texts)


def test_prospects_are_drawn_for_every_parameter_that_was_asked_for(result: Calibration) -> None:
    observability = observe(result.solution.problem)
    axes = observability.plot()
    arm = result.solution.problem.names[: result.solution.problem.arm_count]
    names = [tick.get_text() for tick in axes.get_yticklabels()]
    assert names == [n for n in arm if observability.prospects[n].state != "fixed"]
    ends = sorted(bar.get_x() + bar.get_width() for bar in axes.patches)
    shares = [
        p.std / p.plausible if p.std else 1.0
        for p in observability.prospects.values()
        if p.name in names
    ]
    np.testing.assert_allclose(ends, sorted(shares))


def test_objects_are_short_on_a_console_and_tables_in_a_notebook(result: Calibration) -> None:
    observability = observe(result.solution.problem)
    job, solution = result.job, result.solution
    samples = job.observations[0].poses.samples
    for each in (job.arm, job.parameters, samples, job, result, solution, observability):
        assert len(repr(each)) < 250
        assert "array" not in repr(each)
        html = each._repr_html_()
        assert "<script" not in html
        assert "http" not in html
    assert result.headline in repr(result)
    assert "joint_4.z" in solution._repr_html_()
    assert result.assessment.word in result._repr_html_()
    assert result.headline in result._repr_html_()
    assert observability._repr_html_().count(observability.sentence[1:]) == 1
    assert all(name in observability._repr_html_() for name in job.parameters)
    assert all(f"<td>{joint}</td>" in job.arm._repr_html_() for joint in job.arm.joints)


def test_the_headline_is_the_held_out_rms(result: Calibration) -> None:
    was, now = result.accuracy.validation[0].before.rms, result.accuracy.validation[0].after.rms
    first, _, rest = result.headline.partition(" → ")
    assert float(first) == pytest.approx(mm(was), rel=0.06)
    assert float(rest.split()[0]) == pytest.approx(mm(now), rel=0.06)
    assert "validation" in rest


def test_arrows_are_as_long_as_can_be_told() -> None:
    vectors = np.array([[0.0, 0.0, 1e-3]] * 50)
    assert magnification(vectors, 1.0) == 200.0
    assert magnification(vectors, 0.0) == 1.0
    assert magnification(np.zeros((0, 3)), 1.0) == 1.0
    assert len(range(10**6)[drawn_rows(10**6)]) <= 1500
    assert len(range(7)[drawn_rows(7)]) == 7


def test_of_many_samples_some_are_drawn_and_they_are_where_they_were(
    result: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    def arrows() -> Arrows:
        return next(part for part in result.scene().parts if isinstance(part, Arrows))

    every = arrows()
    monkeypatch.setattr("suta_calib.plotting.scene.MOST_DRAWN", 5)
    some = arrows()
    assert 0 < len(some.points) <= 5 < len(every.points)
    np.testing.assert_allclose(some.points, every.points[:: len(every.points) // 5], atol=1e-9)
