"""Exceptions for users. Each message is one clear line."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class InputError(ValueError):
    """Invalid input. The message names the field, the grain or file, and the value.

    Examples
    --------
    >>> wg.Scene.load("annulus", ["physics.drag=-1"])
    Traceback (most recent call last):
        ...
    warpgrains.base.errors.InputError: annulus: physics.drag is -1.0: it must be 0 or more
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(" ".join(message.splitlines()))  # a value may hold several lines


class NoAreaError(InputError):
    """Area of a container whose walls leave it open or of unknown shape, or of a region without points.

    Examples
    --------
    >>> stub = wg.Segment((0.5, -0.1), (0.6, -0.1))
    >>> analysis.packing_fraction(wg.Simulation(simulation.scene.replace(walls=[stub])))
    Traceback (most recent call last):
        ...
    warpgrains.base.errors.NoAreaError: the walls do not form a convex polygon around the grains: ...
    """


class OutputError(InputError):
    """Output that another process writes, or that would replace a file of another kind.

    The file is left unchanged.

    Examples
    --------
    >>> np.savetxt("notes.usdc", [1.0])
    >>> simulation.run(steps=1, record="notes.usdc")
    Traceback (most recent call last):
        ...
    warpgrains.base.errors.OutputError: refusing to overwrite 'notes.usdc': not a recording of warpgrains
    """


class LockedError(OutputError):
    """Output that another process writes."""


class MissingExtraError(InputError):
    """Library that is not installed. The message names it and the command that installs its extra."""


class SimulationError(RuntimeError):
    """Failure of a run. The message names the step and the grain, and the last good state is kept.

    Examples
    --------
    >>> strict = wg.Simulation(wg.Scene.load("annulus"), max_iterations=3, on_unconverged="raise")
    >>> strict.run()
    Traceback (most recent call last):
        ...
    warpgrains.base.errors.SimulationError: step 20, from t = 0.19 s: not converged after 3 iterations: ...
    """


@contextmanager
def written_as(names: Mapping[str, str], where: str = "") -> Iterator[None]:
    """Change messages of InputErrors in a block, so that they name fields as the user has written them.

    `names` holds the user's names by field, such as "physics.drag" for "drag". A field at the start of a
    message is replaced by its name there. `where`, such as the name of a file, is put before the message.
    """
    try:
        yield
    except InputError as error:
        message = re.sub(
            r"^(unknown )?(\w+)", lambda own: (own[1] or "") + names.get(own[2], own[2]), str(error)
        )
        raise type(error)(f"{where}: {message}" if where else message) from None


@contextmanager
def requiring(what: str, extra: str = "report") -> Iterator[None]:
    """Raise MissingExtraError if the block imports a library of `extra` that is not installed.

    `what` names the object that needs the library, such as a file, in the message.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{what} needs {error.name}: {_installing(extra)}") from error


def _installing(extra: str) -> str:
    """Return the command that installs the libraries of an extra, for messages.

    It lists the libraries, because pip finds this package, and so the extra, in no index. For a checkout
    without metadata, the text names the extra instead.
    """
    from importlib.metadata import PackageNotFoundError, requires  # slow to import

    try:
        needs = [need.partition(";") for need in requires("warpgrains") or []]
    except PackageNotFoundError:  # a checkout on PYTHONPATH
        needs = []
    names = [f"'{name}'" for name, _, when in needs if when.strip() == f'extra == "{extra}"']
    return " ".join(["pip install", *names]) if names else f"install the extra [{extra}] of pyproject.toml"
