"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.75, 2.8, 2.55, 3.2),
    "packing fraction": (0.8350992722, 0.832167384, 0.8322147269, 0.8311239744),
    "coordination": (3.835, 3.84, 3.83, 3.84),
    "pressure [N/m]": (10.00882047, 10.06791977, 9.956424533, 9.982424),
    "stress yy / xx": (1.031416594, 1.005021156, 1.063676837, 1.042283999),
    "mean force [N]": (1.985752235, 1.946195446, 1.92912146, 1.981155908),
    "deviation / mean": (0.9908673269, 0.9638841947, 1.005937702, 1.026346311),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
