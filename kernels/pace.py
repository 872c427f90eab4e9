"""The number of threads of a team: fewer while waiting costs more than they gain, and then more again.

Where another process has a core, the thread of a team that is to run there comes to a barrier late, by a time
slice of the system's: milliseconds, for a stage that takes microseconds. The first thread counts the time
that it waits. When that is more than a share of all its time, half of the threads leave the team at the next
barrier, and end their launch. As the first thread does at least its own part of the work in the rest of the
time, a team takes at most 1 / (1 - share) times as long as one thread, plus that first wait.

A larger team is tried after a pause, which makes the waits that it cost a small part of the time, and doubles
with every trial that fails.
"""

import warp as wp

from .threads import Team, is_member
from .waiting import (
    GATE,
    MEETINGS,
    SIZE,
    arrive,
    begin_look,
    close_gate,
    end_look,
    enter_gate,
    let_go,
    seconds,
    wake,
    word_at,
)

f64 = wp.float64
JOINING = wp.constant(f64(6.0e-3))  # seconds: the same share of it is waited for others to begin
SHORT = wp.constant(f64(1.0e-3))  # seconds: the least time of which waiting is a share
WINDOW = wp.constant(f64(16.0e-3))  # seconds after which older waits count half
LONGEST = wp.constant(f64(1.0))  # pause [s]
WORTH = wp.constant(f64(16.0))  # seconds of pause for each second that was waited


@wp.func
def shrink(team: Team, size: int, waited: f64, now: f64):
    """Shrink the team from the next barrier on, for a pause in proportion to the time that it waited."""
    pause = wp.min(wp.max(f64(2.0) * team.pace[0].pause, WORTH * waited), LONGEST)
    team.pace[0].size = size
    team.pace[0].pause = pause
    team.pace[0].rest = pause
    team.pace[0].waited = f64(0.0)
    team.pace[0].window = now


@wp.func
def count_waiting(team: Team, begun: f64):
    """Add the first thread's wait since `begun`; halve the team if it waits too much."""
    now = seconds()
    waited = team.pace[0].waited + now - begun
    gone = now - team.pace[0].window
    team.pace[0].waited = waited
    if waited > team.pace[0].share * wp.max(gone, SHORT):
        shrink(team, wp.max(1, team.size // 2), waited, now)
    elif gone > WINDOW:
        team.pace[0].window = now - f64(0.5) * gone
        team.pace[0].waited = f64(0.5) * waited
        team.pace[0].pause = f64(0.5) * team.pace[0].shortest


@wp.func
def wait_until(team: Team, k: int, least: wp.int64):
    """Wait until a word of the team has reached a count."""
    begun = f64(0.0)
    look = int(0)
    found = bool(word_at(team.words, k) >= least)
    if not found and team.rank == 0:
        begun = seconds()
    while not found:
        event = begin_look(team.words, look)
        found = word_at(team.words, k) >= least
        end_look(team.words, look, event, found)
        look += 1
    if begun > f64(0.0):
        count_waiting(team, begun)


@wp.func(inline=False)
def meet(team: Team):
    """Wait for all threads. Not inlined, so that it is compiled once and not after every stage."""
    meetings = word_at(team.words, MEETINGS) + wp.int64(1)
    if arrive(team.words, team.size):
        let_go(team.words, team.pace[0].size)
        wake(team.words)
    else:
        wait_until(team, MEETINGS, meetings)
    team.size = int(word_at(team.words, SIZE))


@wp.func
def barrier(team: Team):
    """Publish what each CPU thread has written to the others. Does nothing for one thread, or on a GPU."""
    if team.size > 1 and team.words.shape[0] > 0 and is_member(team):
        meet(team)


@wp.func
def join(team: Team):
    """Form a team of the threads that have begun their launch; a late thread ends its launch."""
    if team.rank > 0:
        team.rank = enter_gate(team.words)
        wake(team.words)
        if team.rank > 0:
            wait_until(team, MEETINGS, wp.int64(1))
            team.size = int(word_at(team.words, SIZE))
        else:
            team.size = 0
    elif team.size > 1:
        gather(team)


@wp.func
def gather(team: Team):
    """Wait a short time for the other threads to begin."""
    begun = seconds()
    most = team.pace[0].share * JOINING
    team.pace[0].window = begun - team.pace[0].window
    team.pace[0].clock = begun
    wanted = team.pace[0].size
    look = int(0)
    found = bool(wanted == 1)
    while not found:
        event = begin_look(team.words, look)
        found = word_at(team.words, GATE) + wp.int64(1) >= wp.int64(wanted)
        found = found or seconds() - begun > most
        end_look(team.words, look, event, found)
        look += 1
    joined = 1 + close_gate(team.words)
    if joined < wanted:
        shrink(team, joined, most, seconds())
    team.size = joined
    let_go(team.words, joined)
    wake(team.words)


@wp.func
def leave(team: Team):
    """Save the first thread's counts for the next launch."""
    if team.rank == 0 and is_member(team) and team.pace.shape[0] > 0:
        team.pace[0].window = seconds() - team.pace[0].window


@wp.func
def is_to_grow(team: Team) -> bool:
    """Return whether a larger team is to be tried, in another launch."""
    if team.pace.shape[0] == 0:
        return False
    return team.pace[0].size < team.pace[0].most and team.pace[0].rest <= f64(0.0)


@wp.func
def count_rest(team: Team):
    """Count the time of a step as a part of the pause."""
    if team.pace.shape[0] > 0 and team.pace[0].size < team.pace[0].most:
        now = seconds()
        team.pace[0].rest = team.pace[0].rest - (now - team.pace[0].clock)
        team.pace[0].clock = now
