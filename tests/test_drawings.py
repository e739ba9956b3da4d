"""Pictures: nothing clipped, a unit on every axis, plain numbers."""

import json

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import DT, MODEL
from matplotlib.backends.backend_agg import FigureCanvasAgg

import figures
import sensorid
import sensorlab
from figures import fig4
from sensorlab import drawings
from sensorlab.drawings import style
from sensorlab.drawings.style import plain_number, with_plain_logs
from sensorlab.gap.curves import view
from sensorlab.readers import Recording

KINDS = "none", "bias_step", "outliers", "quantization", "unknown", "undecided"
WITHOUT_UNIT = {"probability", "probability of a wrong model",
                "relative standard deviation", "samples over those expected",
                "power of the residuals, 1 if white", "correlation of the residuals",
                ""}    # the places, which have names


def check(fig):
    """No text outside the figure or over another's axes, a unit on every axis, no
    legend entry without a mark.
    """
    canvas = FigureCanvasAgg(with_plain_logs(fig))
    canvas.draw()
    renderer = canvas.get_renderer()
    whole = fig.get_window_extent(renderer)
    shown = [t for t in fig.findobj(lambda a: hasattr(a, "get_text"))
             if t.get_visible() and t.get_text().strip()]
    ticks = [t for ax in fig.axes for axis in (ax.xaxis, ax.yaxis)
             for t in axis.get_ticklabels(which="both")]
    for text in shown:
        box = text.get_window_extent(renderer)
        if not box.width:
            continue    # a tick beyond the limits
        inside = whole.x0 - 1 <= box.x0 and box.x1 <= whole.x1 + 1
        assert text in ticks or inside and box.y0 >= -1 and box.y1 <= whole.y1 + 1, text
        assert "$" not in text.get_text() and "\\" not in text.get_text()
    for ax in fig.axes:
        for label in (ax.get_xlabel(), ax.get_ylabel()):
            assert label in WITHOUT_UNIT or ", " in label or "/" in label, label
        handles, _ = ax.get_legend_handles_labels()
        for handle in handles:
            x = getattr(handle, "get_xdata", lambda: [])()
            colour = getattr(handle, "get_color", lambda: None)()
            named = len(x) == 0 and colour in ("0.4", style.INK)    # explains a style
            assert named or not len(x) or np.isfinite(
                np.asarray(handle.get_ydata(), float)).any()
        assert bool(handles) == (ax.get_legend() is not None)


@pytest.mark.parametrize("kind", KINDS)
def test_a_diagnosis_is_drawn_whole(answers, kind, tmp_path):
    d, record = answers[kind]
    fig = drawings.draw_diagnosis(d, view(d), record, "mg")
    check(fig)
    assert len(fig.axes) == 3
    assert fig.axes[0].get_ylabel() == "error, mg"
    drawings.save(fig, tmp_path / "d.png")
    assert (tmp_path / "d.png").read_bytes()[:4] == b"\x89PNG"


def test_each_kind_of_effect_is_shown_in_its_own_way(answers):
    label = {kind: drawings.draw_diagnosis(d, view(d), record, "mg").axes[2].get_xlabel(
        ) for kind, (d, record) in answers.items()}
    assert label["none"] == "distance from simulated records, sd"
    assert label["bias_step"] == "the bias step should add, sd of a sample"
    assert label["outliers"] == "residual, sd" and label["quantization"] == "time, s"


@pytest.mark.large
def test_lost_samples_are_marked_below_a_record_that_is_shown_without_them():
    rng = np.random.default_rng(1)
    lost = rng.random(800) < 0.03
    y = np.where(lost, -9999.0, rng.standard_normal(800))
    d = sensorlab.diagnose(y, DT, [sensorid.hypothesis("white_noise",
                                                       sigma_v=(0.5, 2.0))])
    fig = drawings.draw_diagnosis(d, view(d), Recording("r.npz", "error", y, DT), "mg")
    check(fig)
    ax = fig.axes[0]
    (marks,) = [line for line in ax.lines if line.get_label() == "lost samples"]
    assert len(marks.get_xdata()) == lost.sum() and ax.get_ylim()[0] > -10.0


def test_the_picture_of_identify(tmp_path):
    y = sensorid.simulate(MODEL, DT, 500, seed=1).error[0]
    posterior = sensorid.identify(y, DT, MODEL)
    record = Recording("a $name$.csv", "gyro_x", y, DT, unit="deg/s")
    fig = drawings.draw_identify(record, posterior, "deg/s")
    assert fig.axes[0].get_ylabel() == "Allan deviation, deg/s"
    drawings.save(fig, tmp_path / "p.svg")    # a $ is none of ours
    fig.axes[0].get_legend().set_title("")
    check(fig)


def test_the_pictures_of_criteria():
    result = sensorid.criteria(MODEL, DT, 40.0, trials=16, seed=1)
    check(drawings.draw_criteria(result))
    rows = [dict(dt=dt, sigma_v=sigma_v, label="error_probability", target=0.1,
                 duration=length, interval=(0.8 * length, 1.2 * length))
            for dt, sigma_v, length in ((0.1, 0.1, 30.0), (0.1, 1.0, 60.0),
                                        (1.0, 0.1, np.nan), (1.0, 1.0, np.nan))]
    fig = drawings.draw_design(rows, 100.0, "deg/h")
    check(fig)
    _, labels = fig.axes[0].get_legend_handles_labels()
    assert labels == ["dt = 0.1 s", "dt = 1 s", "not within 100 s"]
    fig = drawings.draw_design(rows[:2], 100.0, "deg/h")
    assert fig.axes[0].get_legend_handles_labels()[1] == ["dt = 0.1 s"]
    fig = drawings.draw_design([dict(r, sigma_v=None) for r in rows[::2][:1]], 100.0,
                               "deg/h")
    assert fig.axes[0].get_legend() is None    # one line needs no name


def test_both_panels_of_figure_4_say_what_they_show():
    result = sensorid.criteria([figures.case(1, fig4.RANGES[0])[1]], DT, 40.0,
                               trials=16, seed=1)
    fig = fig4.draw([result])
    for ax in fig.axes:
        assert ax.get_legend().get_texts()[0].get_text().endswith("min, real")
    plt.close(fig)


@pytest.mark.parametrize("x, text", [
    (0.02, "0.02"), (30.0, "30"), (20000.0, "20000"), (1e-5, "10⁻⁵"), (2e6, "2·10⁶"),
    (0.0, "0"), (0.3, "0.3"), (1e12, "10¹²")])
def test_numbers_on_axes_are_plain(x, text):
    assert plain_number(x) == text


def test_logarithmic_axes_have_plain_numbers():
    fig, (ax,) = style.new_figure(5.0, 3.0)
    ax.set(xscale="log", yscale="log", xlim=(8.0, 60.0), ylim=(1e-3, 1e3))
    FigureCanvasAgg(with_plain_logs(fig)).draw()

    def shown(axis):
        return [t.get_text() for t in axis.get_ticklabels(which="both") if t.get_text()]
    assert {"10", "20", "30"} <= set(shown(ax.xaxis))
    assert {"0.001", "1", "1000"} <= set(shown(ax.yaxis))


def test_to_draw_leaves_matplotlib_as_it_was(answers):
    import matplotlib
    before = json.dumps(dict(matplotlib.rcParams), default=str)
    d, record = answers["none"]
    drawings.draw_diagnosis(d, view(d), record, "mg")
    assert json.dumps(dict(matplotlib.rcParams), default=str) == before
