"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.7, 2.75, 2.45, 3.05),
    "packing fraction": (0.8306528436, 0.832224184, 0.8327836479, 0.8275639873),
    "coordination": (3.835, 3.84, 3.84, 3.84),
    "pressure [N/m]": (10.18000765, 10.13814485, 9.891838291, 10.04394308),
    "stress yy / xx": (0.9786896437, 0.9729955028, 1.084616473, 1.0402378),
    "mean force [N]": (1.994904261, 1.9660001, 1.910481478, 1.988287472),
    "deviation / mean": (0.9410942105, 0.96739601, 0.9767902829, 1.088156767),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
