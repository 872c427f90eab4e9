"""Modified checkpoints, such as invalid ones, for tests."""

import json

import numpy as np


def rewrite_checkpoint(path, header=None, **arrays):
    """Change a checkpoint file: values in its header, and arrays by name, such as part__field.

    None removes an entry.
    """
    with np.load(path, allow_pickle=False) as archive:
        entries = dict(archive)
    text = json.loads(entries["header"].tobytes())
    for name, value in (header or {}).items():
        text[name] = text[name] | value if isinstance(value, dict) else value
    entries["header"] = np.frombuffer(json.dumps(text).encode(), np.uint8)
    entries |= {name.replace("__", "."): array for name, array in arrays.items()}
    np.savez(path, **{name: array for name, array in entries.items() if array is not None})
