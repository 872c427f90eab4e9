"""Pictures of sweeps: what is asked for, and that the lines are those of the table."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from sweeps import batch

from warpgrains.sweep import plot
from warpgrains.sweep.plot import SweepPlot


def drawn(plot, **columns):
    """Return the axes on which columns of a table are drawn."""
    axes = Figure().subplots()
    plot.draw_on(axes, {name: list(map(str, cells)) for name, cells in columns.items()})
    return axes


def test_a_point_a_run_and_a_line_through_the_means():
    axes = drawn(SweepPlot("a", "pile_height"), a=[2, 1, 1, 2], pile_height=[3.0, 1.0, 2.0, 5.0])
    points, line = axes.lines
    assert np.array_equal(points.get_xydata(), [[2, 3], [1, 1], [1, 2], [2, 5]])
    assert np.array_equal(line.get_xydata(), [[1, 1.5], [2, 4]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("a", "pile_height [m]")


def test_a_line_a_color():
    axes = drawn(SweepPlot("a", "c", "b"), a=[1, 1, 2, 2], b=["x", "y", "x", "y"], c=[1.0, 2.0, 3.0, 4.0])
    assert [text.get_text() for text in axes.get_legend().texts] == ["x", "y"]
    for line, expected in zip(axes.lines[1::2], ([[1, 1], [2, 3]], [[1, 2], [2, 4]]), strict=True):
        assert np.array_equal(line.get_xydata(), expected)
    assert axes.lines[0].get_color().tolist() != axes.lines[2].get_color().tolist()


def test_words_are_named_on_their_axis():
    axes = drawn(SweepPlot("m", "drag_power"), m=["slow", "fast", "slow"], drag_power=[1.0, 2.0, 3.0])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["slow", "fast"]
    assert np.array_equal(axes.lines[1].get_xydata(), [[0, 2], [1, 2]])
    assert axes.get_ylabel() == "drag_power [W]"


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        ([1e-8, 1e-7, 1e-6], "log"),
        ([1, 10], "linear"),
        ([10, 30, 100], "log"),
        ([10, 20, 30, 40], "linear"),
        (list(range(1, 101)), "linear"),
        ([0, 10, 1000], "linear"),
        ([5], "linear"),
    ],
)
def test_even_ratios_are_drawn_evenly(values, scale):
    assert drawn(SweepPlot("a", "c"), a=values, c=[1.0] * len(values)).get_xscale() == scale


def test_picture_of_a_table_that_is_there(tmp_path, capsys):
    """Without a sweep; runs that failed are left out."""
    (tmp_path / "results.csv").write_text("a,c,error\n1,1.0,\n2,2.0,\n3,,it broke\n")
    assert batch("-o", tmp_path, "--plot", "x=a, y=c") == 0
    assert capsys.readouterr().out == f"{tmp_path / 'c-a.png'}\n"
    assert imread(tmp_path / "c-a.png").std() > 0.0


def test_of_very_many_runs_some_are_points_and_all_are_in_the_means(monkeypatch):
    monkeypatch.setattr(plot, "MOST_POINTS", 10)
    axes = drawn(SweepPlot("a", "c"), a=[1, 2] * 50, c=range(100))
    points, line = axes.lines
    assert points.get_xdata().tolist() == [1] * 5 + [2] * 5
    assert np.array_equal(line.get_xydata(), [[1, 49], [2, 50]])
    assert axes.get_title() == "100 runs, a point for one of 10"
