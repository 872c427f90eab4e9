"""Strips of space, one a CPU thread, so that threads wait for each other at a border and nowhere else.

Every grain belongs to a strip, every thread has one, and a pair is swept by the thread of its first grain's
strip. A thread sweeps its pairs in the common order, in segments: stretches that it sweeps without a pause.
Where the last pair before c on one of c's grains is another thread's, a segment of that thread ends with it,
and a segment that depends on it begins with c. If that pair is far behind c, the segment ends only LAG pairs
before c in the common order, so that one wait does for many pairs. The first pair in the common order that is
not yet swept never waits, so the threads never block each other for good.

The strips decide who sweeps a pair, and not what it finds: no result depends on them.
"""

import warp as wp

from .record import Scene, grain_count, pair_count, wall_count

f64 = wp.float64
LAG = wp.constant(1024)


@wp.func
def bin_of(s: Scene, x: f64) -> int:
    """The bin of a coordinate, between the outer walls."""
    bins = s.strips.bins.shape[0]
    place = f64(0.5) * (f64(1.0) + x / s.walls.radius_out) * f64(bins)
    return int(wp.clamp(place, f64(0.0), f64(bins - 1)))


@wp.func
def crossing_axis(s: Scene) -> int:
    """The axis that the numbering of the grains follows least: a strip across it has grains of all numbers.

    Contacts are swept in the order of their grains' numbers, so every thread soon has something to do.
    """
    n = grain_count(s)
    mean = wp.vec2d(f64(0.0), f64(0.0))
    for i in range(n):
        mean = mean + s.grains.position[i] / f64(n)
    alike = wp.vec2d(f64(0.0), f64(0.0))
    spread = wp.vec2d(f64(1.0e-300), f64(1.0e-300))
    for i in range(n):
        d = s.grains.position[i] - mean
        alike = alike + (f64(i) - f64(0.5) * f64(n - 1)) * d
        spread = spread + wp.cw_mul(d, d)
    if alike[0] * alike[0] * spread[1] <= alike[1] * alike[1] * spread[0]:
        return 0
    return 1


@wp.func
def cut_into_strips(s: Scene):
    """Give every grain a strip, so that all strips have about as many pairs."""
    axis = crossing_axis(s)
    bins = s.strips.bins
    strips = s.strips.cursor.shape[0]
    for b in range(bins.shape[0]):
        bins[b] = 0
    for i in range(grain_count(s)):
        b = bin_of(s, s.grains.position[i][axis])
        bins[b] = bins[b] + s.neighbors.start[i + 1] - s.neighbors.start[i]
    before = wp.int64(0)
    pairs = wp.max(wp.int64(1), wp.int64(pair_count(s)))
    for b in range(bins.shape[0]):
        count = wp.int64(bins[b])
        bins[b] = wp.min(strips - 1, int(before * wp.int64(strips) / pairs))
        before = before + count
    for i in range(grain_count(s)):
        s.strips.strip[i] = bins[bin_of(s, s.grains.position[i][axis])]


@wp.func
def begin_walk(s: Scene):
    """Forget what came last on every grain, and find where every strip begins."""
    count = s.strips.cursor.shape[0]
    for i in range(grain_count(s)):
        s.strips.last[i] = wp.vec2i(-1, 0)
    for k in range(count * count):
        s.strips.seen[k] = 0
    for w in range(count):
        s.strips.cursor[w] = 0
    for c in range(pair_count(s)):
        w = s.strips.strip[s.workspace.sequence[c][0]]
        if w + 1 < count:
            s.strips.cursor[w + 1] = s.strips.cursor[w + 1] + 1
    for w in range(1, count):
        s.strips.cursor[w] = s.strips.cursor[w] + s.strips.cursor[w - 1]
    for w in range(count):
        s.strips.late_cursor[w] = s.strips.cursor[w]


@wp.func
def wait_of(s: Scene, w: int, i: int):
    """Whom strip w must wait for on grain i, up to which pair of it; or (-1, 0) if it already does."""
    before = s.strips.last[i]
    other = before[0]
    if other < 0 or other == w:
        return -1, 0
    place = w * s.strips.cursor.shape[0] + other
    if before[1] <= s.strips.seen[place]:
        return -1, 0
    end = wp.max(before[1], s.strips.late_cursor[other])
    s.strips.seen[place] = end
    return other, end


@wp.func
def walk_on(s: Scene, c: int):
    """Go on from place c of the common order to the next."""
    pair = s.workspace.sequence[c]
    w = s.strips.strip[pair[0]]
    own = s.strips.cursor[w] + 1
    s.strips.cursor[w] = own
    s.strips.last[pair[0]] = wp.vec2i(w, own)
    s.strips.last[pair[1]] = wp.vec2i(w, own)
    if c >= LAG:
        late = s.strips.strip[s.workspace.sequence[c - LAG][0]]
        s.strips.late_cursor[late] = s.strips.late_cursor[late] + 1


@wp.func
def deal_pairs(s: Scene):
    """Give every pair its place, strip by strip, and mark where segments begin."""
    pairs = pair_count(s)
    count = s.strips.cursor.shape[0]
    begin_walk(s)
    for c in range(pairs):
        s.strips.segment[c] = 0
    for w in range(count):
        s.strips.first_segment[w] = s.strips.cursor[w]
        if s.strips.cursor[w] < pairs:
            s.strips.segment[s.strips.cursor[w]] = 1
    for c in range(pairs):
        pair = s.workspace.sequence[c]
        w = s.strips.strip[pair[0]]
        own = s.strips.cursor[w]
        for k in range(2):
            other, end = wait_of(s, w, pair[k])
            if other >= 0:
                s.strips.segment[own] = 1
                if end < pairs:
                    s.strips.segment[end] = 1
        s.workspace.sweep_index[pair[2]] = own
        walk_on(s, c)


@wp.func
def number_segments(s: Scene):
    """Number the segments from pair to pair, and tell where each, and each strip, begins."""
    pairs = pair_count(s)
    count = s.strips.cursor.shape[0]
    segments = int(0)
    for c in range(pairs):
        if s.strips.segment[c] != 0:
            s.contacts.set_start[segments] = c
            segments += 1
        s.strips.segment[c] = segments - 1
    s.contacts.set_start[segments] = pairs
    s.contacts.count.sets = segments
    for w in range(count):
        begin = s.strips.first_segment[w]
        s.strips.first_segment[w] = segments
        if begin < pairs:
            s.strips.first_segment[w] = s.strips.segment[begin]
    s.strips.first_segment[count] = segments


@wp.func
def find_dependencies(s: Scene):
    """Tell after how many segments of each other strip a segment comes."""
    count = s.strips.cursor.shape[0]
    for t in range(s.contacts.count.sets * count):
        s.strips.dependencies[t] = 0
    begin_walk(s)
    for c in range(pair_count(s)):
        pair = s.workspace.sequence[c]
        w = s.strips.strip[pair[0]]
        own = s.strips.cursor[w]
        for k in range(2):
            other, end = wait_of(s, w, pair[k])
            if other >= 0:
                ended = s.strips.segment[end - 1] + 1 - s.strips.first_segment[other]
                s.strips.dependencies[s.strips.segment[own] * count + other] = ended
        walk_on(s, c)


@wp.func
def deal_walls(s: Scene):
    """Sort the grains at the walls by strip: strip after strip is brought to the front."""
    walls = wall_count(s)
    done = int(0)
    for w in range(s.strips.cursor.shape[0]):
        s.strips.first_wall[w] = done
        for c in range(done, walls):
            contact = s.contacts.walls[c]
            if s.strips.strip[contact.i] == w:
                dv_start = s.contacts.wall_dv_start[c]
                s.contacts.walls[c] = s.contacts.walls[done]
                s.contacts.wall_dv_start[c] = s.contacts.wall_dv_start[done]
                s.contacts.walls[done] = contact
                s.contacts.wall_dv_start[done] = dv_start
                done += 1
    s.strips.first_wall[s.strips.cursor.shape[0]] = done


@wp.func
def make_strips(s: Scene):
    """Deal the pairs and walls of a list out to the threads."""
    cut_into_strips(s)
    deal_pairs(s)
    number_segments(s)
    find_dependencies(s)
    deal_walls(s)
