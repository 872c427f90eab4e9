"""Pictures of sweeps: what is asked for, and that the lines are those of the table."""

import csv

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from sweeps import batch

from warpgrains.sweep import plot
from warpgrains.sweep.plot import SweepPlot


def rows(**columns):
    """The rows of a table, all of runs that came to their end."""
    return [dict(zip(columns, map(str, cells), strict=True)) for cells in zip(*columns.values(), strict=True)]


def axes_with(plot, table):
    axes = Figure().subplots()
    plot.draw_on(axes, {name: [row[name] for row in table] for name in table[0]})
    return axes


def test_a_point_a_run_and_a_line_through_the_means():
    table = rows(a=[2, 1, 1, 2], pile_height=[3.0, 1.0, 2.0, 5.0])
    points, line = axes_with(SweepPlot("a", "pile_height"), table).lines
    assert np.array_equal(points.get_xydata(), [[2, 3], [1, 1], [1, 2], [2, 5]])
    assert np.array_equal(line.get_xydata(), [[1, 1.5], [2, 4]])
    assert (line.axes.get_xlabel(), line.axes.get_ylabel()) == ("a", "pile_height [m]")


def test_a_line_a_color():
    table = rows(a=[1, 1, 2, 2], b=["x", "y", "x", "y"], c=[1.0, 2.0, 3.0, 4.0])
    axes = axes_with(SweepPlot("a", "c", "b"), table)
    lines = {
        text.get_text(): line for text, line in zip(axes.get_legend().texts, axes.lines[1::2], strict=True)
    }
    assert np.array_equal(lines["x"].get_xydata(), [[1, 1], [2, 3]])
    assert np.array_equal(lines["y"].get_xydata(), [[1, 2], [2, 4]])
    assert axes.lines[0].get_color().tolist() != axes.lines[2].get_color().tolist()


def test_words_are_named_on_their_axis():
    axes = axes_with(SweepPlot("m", "c"), rows(m=["slow", "fast", "slow"], c=[1.0, 2.0, 3.0]))
    assert [label.get_text() for label in axes.get_xticklabels()] == ["slow", "fast"]
    assert np.array_equal(axes.lines[1].get_xydata(), [[0, 2], [1, 2]])


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
    assert axes_with(SweepPlot("a", "c"), rows(a=values, c=[1.0] * len(values))).get_xscale() == scale


def test_picture_of_a_table_that_is_there(tmp_path, capsys):
    """Without a sweep; runs that failed are left out."""
    table = rows(a=[1, 2, 3], c=[1.0, 2.0, ""], error=["", "", "it broke"])
    with (tmp_path / "results.csv").open("w", newline="") as lines:
        writer = csv.DictWriter(lines, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    assert batch("-o", tmp_path, "--plot", "x=a, y=c") == 0
    assert capsys.readouterr().out == f"{tmp_path / 'c-a.png'}\n"
    assert imread(tmp_path / "c-a.png").std() > 0.0


def test_of_very_many_runs_some_are_points_and_all_are_in_the_means(monkeypatch):
    monkeypatch.setattr(plot, "MOST_POINTS", 10)
    axes = axes_with(SweepPlot("a", "c"), rows(a=[1, 2] * 50, c=range(100)))
    points, line = axes.lines
    assert points.get_xdata().tolist() == [1] * 5 + [2] * 5
    assert np.array_equal(line.get_xydata(), [[1, 49], [2, 50]])
    assert axes.get_title() == "100 runs, a point for one of 10"
