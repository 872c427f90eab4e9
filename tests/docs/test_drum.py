"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.7, 2.75, 2.45, 3),
    "packing fraction": (0.834180485, 0.8323394722, 0.8324185138, 0.8274888275),
    "coordination": (3.84, 3.84, 3.84, 3.84),
    "pressure [N/m]": (10.09368583, 10.05635365, 10.06854863, 10.03606952),
    "stress yy / xx": (1.003081827, 1.007355564, 1.012431674, 1.04228692),
    "mean force [N]": (1.999921934, 1.948050774, 1.944217555, 1.985481082),
    "deviation / mean": (0.9455183747, 0.9852959116, 0.9541935447, 1.088313002),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
