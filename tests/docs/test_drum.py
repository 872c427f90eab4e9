"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.7, 2.8, 2.2, 3.05),
    "packing fraction": (0.8307200465, 0.8321699175, 0.8291908938, 0.827563967),
    "coordination": (3.835, 3.83, 3.84, 3.84),
    "pressure [N/m]": (10.15544397, 10.06604213, 9.893298993, 10.04231328),
    "stress yy / xx": (0.9902418003, 1.004821661, 1.109980919, 1.040415208),
    "mean force [N]": (2.002628309, 1.950648187, 1.934328658, 1.987597797),
    "deviation / mean": (0.9232079806, 0.9617940445, 1.00067984, 1.085545735),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
