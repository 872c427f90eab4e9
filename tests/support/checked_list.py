"""A record of two grains whose list is checked, with numbers that no stage rounds."""

from typing import Any

import numpy as np
from stages import OneRecord, grains_apart

DT, ROUNDING = 0.25, 2.0**-10
BASE_SKIN, RESERVE = 2.0, 2.0**-3
W, X0, U_PATH, U = np.array([4.0, -8.0]), np.array([1.0, 2.0]), np.array([0.5, 0.25]), np.array([1.0, 0.5])
ELAPSED = 0.5
STRAIGHT = X0 + ELAPSED * W + U_PATH
DISPLACEMENT, DEVIATION = 0.625, 5.0  # of (3, 4) / 8 m and (3, 4) m/s
UNMONITORED = 1.0


def record_with(accelerated: bool = False, **numbers: Any) -> OneRecord:
    """Return two grains on their way, the second with more skin than it ever needs."""
    method = "accelerated" if accelerated else "gauss-seidel"
    record = OneRecord(grains_apart(2).replace(dt=DT, method=method), contacts=4)
    record["verlet.reference_velocity"][:], record["verlet.reference_position"][:] = W, X0
    record["grains.position"][:] = STRAIGHT + np.array([3.0, 4.0]) / 8.0
    record["grains.next_velocity"][:] = W + U + np.array([3.0, 4.0])
    for name in ("peak_square", "recent_deviation", "peak_limit"):
        record[f"verlet.{name}"][:] = 0.0
    record["verlet.skin"][:] = 1e3
    record.record["tuning"]["rounding"], record.record["tuning"]["reserve"] = ROUNDING, RESERVE
    known = {
        "elapsed": ELAPSED,
        "frame_shift": U_PATH,
        "frame_velocity": U,
        "unmonitored_change": UNMONITORED,
        "base_skin": BASE_SKIN,
        "frame_skin": 1e3,
        "lifetime": 1e3,
    }
    for name, value in (known | numbers).items():
        part = record.verlet_work if name in record.verlet_work.dtype.names else record.verlet_numbers
        part[name] = value
    set_flags(record, list_expired=0, bad_body=-1)
    return record


def set_flags(record: OneRecord, **flags: int) -> None:
    for name, value in flags.items():
        record.record["verlet"]["flags"][name] = value


def flag(record: OneRecord, name: str) -> int:
    return int(record.record["verlet"]["flags"][name])
