"""The list of candidates built anew by one worker: what warpgrains/contacts.py launches, in one go."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import carry, detect, order, reach
from .data import WALLS
from .record import SceneRecord
from .variant import Variant

f64 = wp.float64
FEW = wp.constant(40)  # grains that are not worth a grid


@wp.func
def starts(count: wp.array(dtype=wp.int32), start: wp.array(dtype=wp.int32)):
    """Where each part starts, of parts of so many entries."""
    total = int(0)
    for k in range(count.shape[0]):
        start[k] = total
        total = total + count[k]


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    search, sweeping, warm, widen = (part.stages(variant) for part in (detect, order, carry, reach))
    save_pairs, save_walls = warm.save_pairs, search.save_walls
    hold_pairs, fill_slots = warm.hold_pairs, warm.fill_slots
    weigh, find_influence = warm.weigh, warm.find_influence
    adapt_slack, renew, clear = widen.adapt_slack, widen.renew, widen.clear
    find_mean, find_spread, find_horizon = widen.find_mean, widen.find_spread, widen.find_horizon
    count_cells, fill_cells, find_pairs = search.count_cells, search.fill_cells, search.find_pairs
    try_all, fill_rows, sort_rows, find_walls = (
        search.try_all,
        search.fill_rows,
        search.sort_rows,
        search.find_walls,
    )
    levels, colors, place = sweeping.levels, sweeping.colors, sweeping.place

    @wp.func
    def set_old_aside(s: SceneRecord):
        """Keep the pairs and corrections of the old list."""
        n = s.grains.position.shape[0]
        for i in range(n):
            save_pairs(i, s.rows, s.workspace.slot, s.contacts, s.workspace.old_pair_dv)
            s.workspace.old_rows.start[i] = s.rows.start[i]
            s.workspace.wall_dv[i] = f64(0.0)
        s.workspace.old_rows.start[n] = s.rows.start[n]
        for k in range(s.rows.start[n]):
            s.workspace.old_rows.neighbor[k] = s.rows.neighbor[k]
        for c in range(s.contacts.count[WALLS]):
            save_walls(c, s.contacts, s.workspace.wall_dv)

    @wp.func
    def renew_reaches(s: SceneRecord):
        """Choose what the new list must reach."""
        n = s.grains.position.shape[0]
        adapt_slack(s.watch, s.progress, s.smallest, s.dt)
        for i in range(n):
            renew(i, s.grains, s.watch, s.progress, s.dt)
        clear(s.watch)
        for i in range(n):
            find_mean(i, s.watch)
        for i in range(n):
            find_spread(i, s.watch)
        find_horizon(s.watch, s.room, s.acceleration, s.dt)

    @wp.func
    def search_cells(s: SceneRecord):
        """Find the pairs within reach by cells, and, if there is room for them, put them in their rows."""
        n = s.grains.position.shape[0]
        for b in range(s.grid.cell_cursor.shape[0]):
            s.grid.cell_cursor[b] = 0
        for i in range(n):
            count_cells(i, s.grains, s.watch, s.grid)
        starts(s.grid.cell_cursor, s.grid.cell_start)
        for i in range(n):
            fill_cells(i, s.grains, s.grid)
            s.rows.cursor[i] = 0
        s.rows.total[0] = 0
        for i in range(n):
            find_pairs(i, s.grains, s.watch, s.grid, s.rows)
        if s.rows.total[0] <= s.rows.found.shape[0]:
            starts(s.rows.cursor, s.rows.start)
            for k in range(s.rows.total[0]):
                fill_rows(k, s.rows)
            for i in range(n):
                sort_rows(i, s.rows)

    @wp.func
    def hold(s: SceneRecord) -> bool:
        """Widen the reach of pairs that carry a correction and are not listed; tell whether there are any."""
        s.workspace.lost[0] = 0
        for i in range(s.grains.position.shape[0]):
            hold_pairs(
                i,
                s.grains,
                s.watch,
                s.workspace.old_rows,
                s.workspace.old_pair_dv,
                s.rows,
                s.workspace.lost,
            )
        return s.workspace.lost[0] != 0

    @wp.func
    def put_in_order(s: SceneRecord):
        """Give every pair its slot, and write it there with the correction that it carries."""
        if s.by_color != 0:
            colors(s.rows, s.workspace.used_colors, s.workspace.group)
        else:
            levels(s.rows, s.window, s.workspace.next_level, s.workspace.group)
        place(s.rows, s.workspace.group, s.merge, s.contacts, s.workspace.slot)
        n = s.grains.position.shape[0]
        for i in range(n):
            s.workspace.influence[i] = f64(0.0)
            fill_slots(
                i,
                s.grains,
                s.workspace.old_rows,
                s.workspace.old_pair_dv,
                s.rows,
                s.workspace.slot,
                s.contacts,
            )
        for i in range(n):
            weigh(i, s.rows, s.workspace.slot, s.contacts, s.workspace.influence)
        for i in range(n):
            find_influence(i, s.workspace.influence, s.watch)

    @wp.func
    def list_walls(s: SceneRecord):
        """List the grains that may reach a wall, with the corrections that they carry."""
        s.contacts.count[WALLS] = 0
        for i in range(s.grains.position.shape[0]):
            find_walls(i, s.grains, s.contacts, s.watch, s.radius_in, s.radius_out, s.workspace.wall_dv)

    @wp.func
    def list_contacts(s: SceneRecord) -> bool:
        """List every pair and wall within reach; return whether there was room, else nothing is lost."""
        searching = bool(True)
        while searching:
            if s.grains.position.shape[0] <= FEW:
                try_all(s.grains, s.watch, s.grid, s.rows)
            else:
                search_cells(s)
            searching = False
            if s.rows.total[0] <= s.rows.found.shape[0]:
                searching = hold(s)
        if s.rows.total[0] > s.rows.found.shape[0]:
            return False
        put_in_order(s)
        list_walls(s)
        return True

    return SimpleNamespace(
        set_old_aside=set_old_aside,
        renew_reaches=renew_reaches,
        put_in_order=put_in_order,
        list_contacts=list_contacts,
    )
