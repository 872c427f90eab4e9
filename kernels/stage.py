"""Stages: functions that kernels of their own launch on many threads, or another kernel calls in a loop."""

import inspect
from types import SimpleNamespace

import warp as wp

from .crew import Crew


def kernels_of(module: wp.Module, *stages: wp.Function) -> SimpleNamespace:
    """Make a kernel of every stage, of the same name."""
    return SimpleNamespace(**{stage.func.__name__: _kernel_of(module, stage) for stage in stages})


def _kernel_of(module: wp.Module, stage: wp.Function) -> wp.Kernel:
    """Make a kernel whose threads call a stage with their number in place of its first `int`.

    A stage of workers begins with `crew: Crew, tid: int`, one of single elements with an `int`; any other is
    called by a single thread.
    """
    types = {name: kind for name, kind in stage.input_types.items() if name != "return"}
    names, name = list(types), stage.func.__name__
    arguments, place = list(names), int(types[names[0]] is Crew)
    if types[names[place]] is int:
        arguments[place] = "wp.tid()"
        del names[place]
    source = f"def {name}({', '.join(names)}):\n    stage({', '.join(arguments)})\n"
    scope = {"wp": wp, "stage": stage}
    exec(source, scope)
    function = scope[name]
    function.__annotations__ = {name: types[name] for name in names}
    function.__doc__ = inspect.getdoc(stage.func)
    return wp.Kernel(function, key=f"launch_{name}", module=module, source=source)
