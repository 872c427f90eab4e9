"""The worked example: one command, with the numbers that it has always had."""

import pytest

from warpgrains.scenes import drum

PINNED = {
    "drag [kg/s]": (0.05, 0.1, 0.2, 0.4),
    "time to rest [s]": (5.7, 2.75, 2.6, 3.05),
    "packing fraction": (0.8306528744, 0.8322241249, 0.8327840291, 0.8275640991),
    "coordination": (3.835, 3.84, 3.84, 3.84),
    "pressure [N/m]": (10.18101413, 10.14057081, 9.89874525, 10.04305041),
    "stress yy / xx": (0.9782306858, 0.9724003389, 1.081630446, 1.040498191),
    "mean force [N]": (1.995151313, 1.966623588, 1.911783545, 1.988078495),
    "deviation / mean": (0.9405022523, 0.9702095047, 0.9741728388, 1.088998618),
}


def test_numbers_are_those_of_before(tmp_path, capsys):
    picture = tmp_path / "drum.png"
    table = drum.main(["-o", str(picture)])
    for name, values in PINNED.items():
        # a run has the same bits everywhere; ten digits are pinned, of which the last is rounded
        assert [row[name] for row in table] == pytest.approx(values, rel=1e-9), name
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert picture.stat().st_size > 30_000
