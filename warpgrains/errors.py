"""What can go wrong, as a user sees it: each message is one clear line."""


class SceneError(ValueError):
    """The input is not a scene: the message names the field, the grain and the value."""


class OutputError(SceneError):
    """What is to be written is in use, or is something else: it is left as it is."""


class SimulationError(RuntimeError):
    """A run failed: the message says which step and which grain, the last good state is kept."""


def missing_extra(what: str, error: ModuleNotFoundError, extra: str = "report") -> SceneError:
    """Return the error for something that needs a library of an extra which is not installed."""
    return SceneError(f"{what} needs {error.name}: pip install 'warpgrains[{extra}]'")
