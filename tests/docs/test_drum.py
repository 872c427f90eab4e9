"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.75, 2.8, 2.3, 3.2),
    "packing fraction": (0.8341646861, 0.8323362504, 0.8286497905, 0.8273939386),
    "coordination": (3.84, 3.84, 3.84, 3.84),
    "pressure [N/m]": (10.09306648, 10.05579015, 10.07299014, 10.02476216),
    "stress yy / xx": (1.004505691, 1.007469992, 1.029822861, 1.046379259),
    "mean force [N]": (2.001763188, 1.947929481, 1.927555609, 1.984346172),
    "deviation / mean": (0.9413211481, 0.9847573407, 1.112819705, 1.09751438),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
