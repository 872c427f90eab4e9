"""HTML pages: one on each homework, with a picture of a wrong answer, and one on the class."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from html import escape
from math import hypot, isfinite

from warpgrains.grade.verdict import Shown, Verdict
from warpgrains.grade.words import Words, in_language

GENERATOR = '<meta name="generator" content="warpgrains grade">'
"""A tag that identifies the pages of this program."""

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; }
td, th { border: 1px solid #ccc; padding: .2rem .6rem; text-align: left; }
.right { color: #1a7f37; } .wrong { color: #c62828; } code, pre { background: #f4f4f4; padding: .1rem .3rem; }
svg { max-width: 100%; background: #fafafa; border: 1px solid #ccc; }
"""
_PIXELS = 420
_EXPECTED, _FOUND = "#1a7f37", "#c62828"


class Pages:
    """Writer of pages in a language of `LANGUAGES`."""

    def __init__(self, language: str):
        self._language = language

    def homework(self, verdict: Verdict) -> str:
        """Return the page of a homework."""
        parts = [f"<h1>{escape(verdict.file)}: {self._colored(verdict.status)}</h1>"]
        parts += [f"<p>{self._say(warning)}</p>" for warning in verdict.warnings]
        if verdict.problem or verdict.compiler:
            parts.append(f"<pre>{escape(verdict.problem or verdict.compiler)}</pre>")
        if verdict.parts:
            scenes = verdict.scenes
            rows = [
                [Words(part.name), *(part.words or [Words(part.status)] * len(scenes))]
                for part in verdict.parts
            ]
            parts += [self._table(["", *scenes], rows), f"<p>{self._say(verdict.seeded())}</p>"]
            parts += [f"<p>{self._say(verdict.graded())}</p>"] if verdict.points else []
        for part in verdict.reported_parts():
            parts.append(f"<h2>{self._say(Words(part.name))}</h2><p>{self._say(part.first)}</p><dl>")
            parts += [f"<dt>{self._say(a)}</dt><dd>{self._say(b)}</dd>" for a, b in part.advice()]
            parts.append("</dl>")
            parts += self._shown(part.shown) if part.shown else []
        return self._page(verdict.file, parts)

    def course(self, verdicts: Sequence[Verdict], links: Sequence[str]) -> str:
        """Return the page of a class; `links` are the addresses of the pages of the homeworks."""
        counts = Counter(verdict.status for verdict in verdicts)
        names = Counter(m.name for verdict in verdicts for part in verdict.parts for m in part.mistakes)
        files = [
            f'<a href="{escape(link)}">{escape(v.file)}</a>' for v, link in zip(verdicts, links, strict=True)
        ]
        same = defaultdict(list)
        for verdict, file in zip(verdicts, files, strict=True):
            same[verdict.values].append(file)
        points = ["points"] if any(verdict.points for verdict in verdicts) else []
        groups = [group for values, group in same.items() if values and len(group) > 1]
        parts = [
            f"<h1>{self._say(Words('Homeworks'))}</h1>",
            self._table([Words("verdict"), Words("homeworks")], counts.most_common()),
            f"<h2>{self._say(Words('Mistakes'))}</h2>",
            self._table([Words("mistake"), Words("homeworks")], names.most_common()),
            f"<h2>{self._say(Words('The same wrong values, to the last bit'))}</h2>",
            f"<p>{self._say(Words('A common mistake in a common style gives the same values, too.'))}</p>",
            *(f"<p>{', '.join(group)}</p>" for group in groups or [[self._say(Words("none"))]]),
            f"<h2>{self._say(Words('All homeworks'))}</h2>",
            "<table>",
            _row(
                "th",
                [self._say(Words(head)) for head in ("file", "verdict", *points, "mistakes", "time [s]")],
            ),
        ]
        for verdict, file in zip(verdicts, files, strict=True):
            row = verdict.as_row(self._language)
            own = [row[in_language(Words(name), self._language)] for name in (*points, "mistakes")]
            cells = [self._colored(verdict.status), *map(escape, own), f"{verdict.seconds:.2f}"]
            parts.append(_row("td", [file, *cells]))
        total = Words("{seconds} s in all", seconds=f"{sum(verdict.seconds for verdict in verdicts):.0f}")
        return self._page(self._say(Words("Homeworks")), [*parts, f"</table><p>{self._say(total)}</p>"])

    def _shown(self, shown: Shown) -> list[str]:
        """Return the scene of a wrong answer: a picture, its parameters and its grains."""
        head, *rows = shown.rows()
        caption = Words("Velocities after this call: expected in green, actual in red")
        return [
            f"<figure>{picture(shown)}<figcaption>{self._say(caption)}</figcaption></figure>",
            f"<p>{self._say(Words('scene before this call'))}: <code>{self._say(shown.numbers())}</code></p>",
            self._table(head, rows),
        ]

    def _table(self, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
        lines = [_row("td", map(self._colored, row)) for row in rows]
        return "".join(["<table>", _row("th", map(self._say, heads)), *lines, "</table>"])

    def _colored(self, cell: object) -> str:
        kind = f' class="{cell}"' if cell in ("right", "wrong") else ""
        return f"<span{kind}>{self._say(cell)}</span>" if kind else self._say(cell)

    def _say(self, text: object) -> str:
        return escape(in_language(text, self._language))

    def _page(self, title: str, parts: Sequence[str]) -> str:
        head = f'<!doctype html><html lang="{self._language}"><head><meta charset="utf-8">{GENERATOR}'
        style = f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>"
        return "\n".join([head, style, *parts, "</body></html>\n"])


def _row(tag: str, cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{cell}</{tag}>' for cell in cells)}</tr>"


def picture(shown: Shown) -> str:
    """Return an SVG picture of a scene, with the expected velocities and those of the homework."""
    call, n = shown.call, shown.call.n
    x, y, _, _, radius, *_ = call.state[: 7 * n].reshape(7, n)
    answers = {_EXPECTED: shown.expected, _FOUND: shown.found}
    speeds = {color: answer.state[2 * n : 4 * n] for color, answer in answers.items()}
    most = max((abs(v) for each in speeds.values() for v in each if isfinite(v)), default=0.0)
    scale = 0.3 * call.radius_out / most if most > 0.0 else 0.0
    size = 1.05 * call.radius_out
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_PIXELS}" height="{_PIXELS}"',
        f' viewBox="{-size:.4g} {-size:.4g} {2 * size:.4g} {2 * size:.4g}">',
        f'<g transform="scale(1 -1)" fill="none" stroke="#555" stroke-width="{0.005 * size:.4g}">',
        *(f'<circle r="{r:.6g}"/>' for r in (call.radius_in, call.radius_out)),
    ]
    grains = zip(x, y, radius, strict=True)
    lines += [f'<circle cx="{a:.6g}" cy="{b:.6g}" r="{r:.6g}" fill="#cfe3ff"/>' for a, b, r in grains]
    width = 0.008 * size
    for color, v in speeds.items():
        for i in range(n):
            u, w = scale * v[i], scale * v[n + i]
            if isfinite(u) and isfinite(w) and hypot(u, w) < size:
                end = f'x2="{x[i] + u:.6g}" y2="{y[i] + w:.6g}"'
                stroke = f'stroke="{color}" stroke-width="{width:.4g}"'
                lines.append(f'<line x1="{x[i]:.6g}" y1="{y[i]:.6g}" {end} {stroke}/>')
        width /= 2  # so that both colors show if the velocities are equal
    lines.append("</g>")
    font = f'font-size="{0.06 * size:.4g}" text-anchor="middle"'
    lines += [f'<text x="{x[i]:.6g}" y="{-y[i]:.6g}" {font}>{i}</text>' for i in range(n)]
    return "".join([*lines, "</svg>"])
