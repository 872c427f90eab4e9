"""Right homeworks in several styles, written from the course text, not from the reference."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "right"

PLAIN = (_FOLDER / "plain.c").read_text()

RIGHT = {
    "helpers, no markers, columns first": (_FOLDER / "helpers.c").read_text(),
    "own arrays, other sums": (_FOLDER / "own_arrays.c").read_text(),
    "zeta also of the first iteration, latin-1 accents": PLAIN.replace(
        "                zeta = fmax(zeta, fabs(dv));\n            }\n",
        "            }\n            zeta = fmax(zeta, fabs(dv));\n",
    ).replace("    iContact = 0;\n", "    iContact = 0;  /* d\xe9but */\n"),
    "iteration 0 counts for iterMax": PLAIN.replace("iter <= iterMax", "iter < iterMax"),
    "the course's style": PLAIN,
    "another header, prints": PLAIN.replace("fem.h", "grains-2024.h").replace(
        "return zeta;", 'printf("%g\\n", zeta); return zeta;'
    ),
    "fast math": '#pragma GCC optimize("O3,fast-math")\n' + PLAIN,
}
