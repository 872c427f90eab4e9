"""The page: grains, keys and buttons, sliders, numbers and curves, and the loop that plays them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import redirect_stdout, suppress
from html import escape
from io import StringIO
from queue import Empty, SimpleQueue
from threading import Thread
from time import perf_counter
from typing import Any, Literal, Self

import numpy as np
import viser
from viser import uplot

from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.drawing.painter import Painter
from warpgrains.view.players import AXES, Live, Pace, Player, Replay
from warpgrains.view.server import HOST, serve_page
from warpgrains.view.sliders import Sliders, value_of
from warpgrains.view.stage import Stage

KEYS: dict[Literal["R", "S", "N", "0"], str] = {"R": "run", "S": "stop", "N": "one step", "0": "restart"}

_TEXTS = 10.0  # a second, at most
_MOST_SPEED = 10.0
_CHART_HEIGHT = 220  # pixels
_STROKES = ("black", "#d55e00")  # of the curves of a chart


class Page:
    """The page of a player, which only browsers of this machine can open, at `port` or the next free one.

    The threads of the server receive key presses and queue the actions that belong to them. `run` performs
    these actions between two steps, in the thread that calls it.
    """

    def __init__(self, player: Player, port: int) -> None:
        self._player = player
        self._asked: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self.is_playing, self._pace = False, Pace(player.dt)
        self._refused: str | None = None
        self._speed, has_chains = 1.0, player.painter.chain_scale is not None
        self._style: dict[str, Any] = {"color_by": player.painter.look.color_by, "forces": has_chains}
        self._server = serve_page(port, f"warpgrains: {player.name}")
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._server.gui.main_panel.dock_right()
        self._stage = Stage(self._server, player.painter)
        self._sliders: Sliders | None = None
        self._add_controls()
        self._texts_at = 0.0
        self._show(texts=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self._server.get_port()}"

    def run(self, announce: Callable[[str], None] = lambda url: None) -> None:
        """Call `announce` with the address of the page, and play until `close`, Ctrl-C or an exception."""
        try:
            announce(self.url)
            while True:
                with suppress(Empty):
                    wanted = self._asked.get(timeout=0.0 if self.is_playing else None)
                    if wanted is None:
                        return
                    wanted()
                if self.is_playing:
                    self._play()
        finally:
            with redirect_stdout(StringIO()):
                self._server.stop()

    def _play(self) -> None:
        """Advance the player to the next frame, draw it, and wait until the next frame is due."""
        if steps := self._pace.due(self._speed):
            self._player.advance(steps)
            self.is_playing = not self._player.has_ended
            self._show(texts=not self.is_playing or perf_counter() - self._texts_at > 1.0 / _TEXTS)
        self._pace.wait()

    def start(self) -> Self:
        """Play in a new thread; return the page."""
        self._thread = Thread(target=self.run, daemon=True)
        self._thread.start()
        return self

    def close(self) -> None:
        """Stop the server, and wait for its end. Meanwhile, all that this process prints is suppressed."""
        self._asked.put(None)
        self._thread.join()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="600"></iframe>'

    def _ask(self, what: Callable[[], None]) -> Callable[[Any], None]:
        """Return a callback that queues the action `what`."""
        return lambda _: self._asked.put(what)

    def _resume(self) -> None:
        self._pace.restart()
        self.is_playing = not self._player.has_ended

    def _pause(self, then: Callable[[], None] = lambda: None) -> None:
        self.is_playing = False
        then()
        self._show(texts=True)

    def _scrub(self, event: viser.GuiEvent[Any]) -> None:
        """Queue a jump to the frame that the frame slider shows, if the browser has moved the slider.

        Do nothing if this program has moved it.
        """
        if event.client is not None:
            frame = round(value_of(event.target))
            self._asked.put(lambda: self._go_to(frame))

    def _go_to(self, frame: int) -> None:
        self._player.restart()
        self._player.advance(frame)
        self._show(texts=True)

    def _set_style(self, **style: Any) -> None:
        self._style |= style
        with suppress(InputError):  # a coloring that does not exist
            self._player.set_style(**self._style)
        self._show(texts=True)

    def _change(self, change: Callable[[], None]) -> None:
        """Change the scene by calling `change`. If this raises InputError, show its message on the page."""
        assert isinstance(self._player, Live)
        try:
            change()
        except InputError as error:
            self._refused = str(error)
        else:
            self._refused = self._sliders.clipped() if self._sliders else None
        if self._colors.options != self._player.colorings:
            self._colors.options = self._player.colorings  # a coloring that is gone becomes the first one
        self._set_style()

    def _show(self, texts: bool) -> None:
        """Draw the present state; with `texts`, renew the numbers, the legend and the curves, too."""
        with self._server.atomic():
            self._stage.show(self._player.snapshot(), self._player.painter)
        if not texts:
            return
        self._texts_at = perf_counter()
        state = "running" if self.is_playing else "stopped"
        rows = self._player.readout()
        error = rows.pop("error", None)
        self._readout.content = _table({"state": state, **rows})
        self._legend.content = _legend(self._player.painter, error or self._refused)
        if isinstance(self._player, Replay):
            self._frame.value = self._player.steps  # type: ignore[misc]
        self._run.label = f"{'resume' if self._player.steps else KEYS['R']} (R)"
        for title, (places, curves) in self._player.curves().items():
            # a chart that is shown again, or begins empty, would have another size
            self._charts[title].data = (places, *curves.values()) if len(places) > 1 else _no_data(curves)

    def _add_controls(self) -> None:
        """Add keys, sliders, numbers and charts in the order in which the page shows them."""
        gui = self._server.gui
        player = self._player
        actions: tuple[Callable[[], None], ...] = (
            self._resume,
            self._pause,
            lambda: self._pause(lambda: player.advance(1)),
            lambda: self._pause(player.restart),
        )
        buttons = []
        for (key, name), action in zip(KEYS.items(), actions, strict=True):
            buttons.append(gui.add_button(f"{name} ({key})"))
            buttons[-1].on_click(self._ask(action))
            gui.add_command(name, hotkey=key).on_trigger(self._ask(action))
        self._run = buttons[0]
        self._readout = gui.add_html("")
        speed = gui.add_slider("playback speed", 0.1, _MOST_SPEED, 0.1, 1.0, hint="1 is real time")
        speed.on_update(lambda _: setattr(self, "_speed", value_of(speed)))
        if player.colorings:
            look = player.painter.look
            self._colors = gui.add_dropdown("color by", player.colorings, initial_value=look.color_by)
            self._colors.on_update(self._ask(lambda: self._set_style(color_by=str(self._colors.value))))
        if player.has_chains:
            chains = gui.add_checkbox("force chains", self._style["forces"])
            chains.on_update(self._ask(lambda: self._set_style(forces=bool(chains.value))))
        if isinstance(player, Live):
            self._sliders = Sliders(gui, player, lambda change: self._ask(lambda: self._change(change)))
            gui.add_button("reset the sliders").on_click(self._ask(self._sliders.reset))
        if isinstance(player, Replay):
            self._frame = gui.add_slider("frame", 0, max(player.last, 1), 1, 0)
            self._frame.on_update(self._scrub)
        self._legend = gui.add_html("")  # below the sliders, so that they do not move when it grows
        self._charts = {
            title: self._add_chart(title, *curves) for title, (_, curves) in player.curves().items()
        }

    def _add_chart(self, title: str, *names: str) -> viser.GuiUplotHandle:
        """Add a chart with curves of these names, which are empty at first."""
        place, value = AXES[title]
        drawn = (
            uplot.Series(label=name, stroke=stroke, width=1.5)
            for name, stroke in zip(names, _STROKES, strict=False)
        )
        return self._server.gui.add_uplot(
            _no_data(names),
            (uplot.Series(label=place), *drawn),
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(label=place), uplot.Axis(label=value)),
            title=title,
            height=_CHART_HEIGHT,
        )


def _no_data(names: Iterable[str]) -> tuple[FloatArray, ...]:
    """Return data that make a chart show no points, in the form of viser: abscissas, then NaN per curve."""
    places = np.array([1.0, 2.0])
    return places, *(places * np.nan for _ in names)


def _table(rows: dict[str, str]) -> str:
    """Return an HTML table with a name and a value per row.

    The cell of a value has the class "value", and the name as its attribute `data-name`.
    """
    cells = (
        f'<tr><td style="width: 50%">{escape(name)}</td>'
        f'<td class="value" data-name="{escape(name)}">{escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    return f'<table style="width: 100%; font-size: 0.8em; margin: 0.4em 1em">{"".join(cells)}</table>'


def _legend(painter: Painter, error: str | None = None) -> str:
    """Return the legend as HTML: the error, if any, the color scale with its unit, and the chain scale.

    The last two are left out if the painter has no scale of colors or draws no force chains.
    """
    lines = [] if error is None else [f'<div style="color: #c00000">{escape(error)}</div>']
    if (scale := painter.colors.scale) is not None:
        colors = ", ".join(f"rgb({r:.0f} {g:.0f} {b:.0f})" for r, g, b in 255.0 * scale.colors()[::7])
        bar = f"height: 0.8em; background: linear-gradient(to right, {colors})"
        ends = f"<span>{scale.low:.3g}</span><span>{scale.label}</span><span>{scale.high:.3g}</span>"
        lines.append(f'<div style="{bar}"></div>')
        lines.append(f'<div style="display: flex; justify-content: space-between">{ends}</div>')
    if painter.top_speed > 0.0:
        lines.append(f"<div>orange grains: {painter.top_speed:.2g} m/s or more</div>")
    if (chains := painter.chain_scale) is not None:
        lines.append(f"<div>force chains: {chains.width:.2g} m wide at {chains.force:.2g} N or more</div>")
    return f'<div class="legend" style="font-size: 0.8em; margin: 0.4em 1em">{"".join(lines)}</div>'
