"""Texts of the page."""

from html import escape

from warpgrains.pictures.shots import Setting


def table(rows: dict[str, str]) -> str:
    """Return names and values as a table; a value's element has the class "value" and its name as data."""
    cells = (
        f'<tr><td style="width: 50%">{escape(name)}</td>'
        f'<td class="value" data-name="{escape(name)}">{escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    return f'<table style="width: 100%; font-size: 0.8em; margin: 0.4em 1em">{"".join(cells)}</table>'


def legend(setting: Setting, error: str | None = None) -> str:
    """Return why the run has ended, the colors with range and unit, and the force of the widest chains."""
    lines = [] if error is None else [f'<div style="color: #c00000">{escape(error)}</div>']
    if setting.scale is not None:
        scale = setting.scale
        colors = ", ".join(f"rgb({r:.0f} {g:.0f} {b:.0f})" for r, g, b in 255.0 * scale.colors()[::7])
        bar = f"height: 0.8em; background: linear-gradient(to right, {colors})"
        ends = f"<span>{scale.low:.3g}</span><span>{scale.label}</span><span>{scale.high:.3g}</span>"
        lines.append(f'<div style="{bar}"></div>')
        lines.append(f'<div style="display: flex; justify-content: space-between">{ends}</div>')
    if setting.chain_scale is not None:
        force, width = setting.chain_scale.force, setting.chain_scale.width
        lines.append(f"<div>force chains: {force:.2g} N or more is {width:.2g} m wide</div>")
    return f'<div class="legend" style="font-size: 0.8em; margin: 0.4em 1em">{"".join(lines)}</div>'
