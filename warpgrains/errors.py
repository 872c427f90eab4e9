"""What can go wrong, as a user sees it: each message is one clear line."""


class SceneError(ValueError):
    """The input is not a scene: the message names the field, the grain and the value.

    Examples
    --------
    >>> wg.Scene.load("annulus", ["physics.drag=-1"])
    Traceback (most recent call last):
        ...
    warpgrains.errors.SceneError: drag is -1.0: it must be 0 or more
    """


class OutputError(SceneError):
    """What is to be written is in use, or is something else: it is left as it is.

    Examples
    --------
    >>> np.savetxt("notes.usdc", [1.0])
    >>> simulation.run(steps=1, record="notes.usdc")
    Traceback (most recent call last):
        ...
    warpgrains.errors.OutputError: refusing to overwrite 'notes.usdc': not a recording of warpgrains
    """


class SimulationError(RuntimeError):
    """A run failed: the message says which step and which grain, the last good state is kept.

    Examples
    --------
    >>> strict = wg.Simulation(wg.Scene.load("annulus"), max_iterations=3, on_unconverged="raise")
    >>> strict.run()
    Traceback (most recent call last):
        ...
    warpgrains.errors.SimulationError: step 20, from t = 0.19 s: not converged after 3 iterations: ...
    """


def missing_extra(what: str, error: ModuleNotFoundError, extra: str = "report") -> SceneError:
    """Return the error for something that needs a library of an extra which is not installed."""
    return SceneError(f"{what} needs {error.name}: pip install 'warpgrains[{extra}]'")
