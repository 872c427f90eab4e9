"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.7, 2.8, 2.55, 2.9),
    "packing fraction": (0.8342202068, 0.8321753255, 0.8325479338, 0.8278089583),
    "coordination": (3.84, 3.83, 3.84, 3.83),
    "pressure [N/m]": (10.13997825, 10.06638301, 9.979971064, 10.09346813),
    "stress yy / xx": (0.9799841718, 1.005175611, 1.04950598, 1.001444225),
    "mean force [N]": (2.013903462, 1.950588191, 1.927627568, 1.977144043),
    "deviation / mean": (0.9790395121, 0.9637528912, 0.9598612646, 1.0151741),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
