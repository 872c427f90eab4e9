"""What homeworks do instead of an answer, in words."""

import signal

FIELDS = ("x", "y", "vx", "vy", "r", "m", "dvBoundary", "dvContacts")
"""Arrays of `femGrains`, one after the other in a state."""

_ANSWERED, _CALLED, _CRASHED, _OUTSIDE, _CHANGED, _TOO_LONG = range(6)
_FORBIDDEN = (
    "opens or changes a file",
    "starts a process or a thread",
    "opens a network connection",
    "takes more memory than it may",
    "aborts (a failed assert, or memory freed twice or written beyond its end)",
)
_CRASHES = {
    "SIGSEGV": "reads or writes where there is no memory, or calls itself without end",
    "SIGFPE": "divides a whole number by zero",
}
_EXITS = {
    "SIGXFSZ": "prints more than a megabyte",
    "SIGXCPU": "computes for too long",
    "SIGKILL": "computes for too long",
    "SIGSYS": "makes a system call that it may not, such as starting a program",
}


class EndedError(Exception):
    """A homework that does not answer: what it does instead."""


def raise_if_ended(kind: int, what: int, where: int, seconds: float) -> None:
    """Raise EndedError unless an answer (child.h) is one."""
    if kind == _CALLED:
        known = 0 <= what < len(_FORBIDDEN)
        raise EndedError(_FORBIDDEN[what] if known else f"makes system call {where}, which it may not")
    if kind == _CRASHED:
        raise EndedError(_crash(what))
    if kind == _OUTSIDE:
        name = FIELDS[what] if 0 <= what < len(FIELDS) else "an array"
        raise EndedError(f"reads or writes {name}[{where}], which is outside of the array")
    if kind == _CHANGED:
        raise EndedError("changes n, radiusIn, radiusOut, gravity, gamma or a pointer of the struct")
    if kind == _TOO_LONG:
        raise EndedError(f"does not end within {seconds:g} s: an endless loop")
    if kind != _ANSWERED:
        raise EndedError("answers what is no answer")


def reason_of_exit(code: int) -> str:
    """Say why a process has ended without a word, from its exit code."""
    return _EXITS.get(_name(-code)) or _crash(-code) if code < 0 else f"ends the program: exit({code})"


def _crash(number: int) -> str:
    name = _name(number)
    return f"crashes: {_CRASHES[name]} ({name})" if name in _CRASHES else f"crashes ({name})"


def _name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
