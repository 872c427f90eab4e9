"""Readers of README.md and the pages of scenes/docs: their blocks of code with output, and their sentences.

A `text` block is the output of the block before it. A comment above a block marks it: `slow`, `not run: WHY`,
or `exit code N`. A TOML block names its file in its first line.
"""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = {path.stem: path for path in [ROOT / "README.md", *sorted((ROOT / "scenes/docs").glob("*.md"))]}

_BLOCK = re.compile(r"^(?:<!-- ([^>]*) -->\n)?```(python|bash|toml|text)\n(.*?)^```$", re.M | re.S)
_COMMAND = re.compile(r"`(warpgrains \w+ [^`]+)`")


class Block(NamedTuple):
    marks: str
    language: str
    text: str

    @property
    def is_slow(self) -> bool:
        return "slow" in self.marks

    @property
    def is_run(self) -> bool:
        return not self.marks.startswith(("not run: ", "test-command"))

    @property
    def exit_code(self) -> int:
        """Exit code of the last command of the block."""
        found = re.search(r"exit code (\d)", self.marks)
        return int(found[1]) if found else 0

    @property
    def lines(self) -> list[str]:
        found = (re.sub(r"(^| +)#.*", "", line) for line in self.text.splitlines())
        return [line for line in found if line]


def blocks(name: str) -> list[Block]:
    return [Block(*found.groups(default="")) for found in _BLOCK.finditer(PAGES[name].read_text())]


def program(name: str) -> str:
    return "\n".join(one.text for one in blocks(name) if one.language == "python" and one.is_run)


def commands_in_words(name: str) -> list[str]:
    """Return the commands of warpgrains that sentences and tables of a page contain."""
    return _COMMAND.findall(PAGES[name].read_text())


_NO_SENTENCES = re.compile(
    r"<!--.*?-->|^```.*?^```$|^\|[^\n]*$|^#+ [^\n]*$", re.M | re.S
)  # tables, code, titles
_LINK = re.compile(r"!?\[([^][]*)\]\([^()]*\)")
_END_OF_PARAGRAPH = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )")
_END_OF_SENTENCE = re.compile(r"(?<=[.!?])(?<!\beq\.)(?<!\beqs\.)[)*]*\s+(?=[A-Z`\"*(\d-])")


def sentences(name: str) -> list[str]:
    """Return the sentences of a page, from its paragraphs and lists. Links are replaced by their text.

    The page "model" is kernels/MODEL.md, whose equations are indented.
    """
    path = ROOT / "kernels/MODEL.md" if name == "model" else PAGES[name]
    source = re.sub(r"^    .*$", "", path.read_text(), flags=re.M) if name == "model" else path.read_text()
    text = _LINK.sub(r"\1", _NO_SENTENCES.sub("\n\n", source))
    paragraphs = (" ".join(one.split()) for one in _END_OF_PARAGRAPH.split(text))
    return [sentence for one in paragraphs for sentence in _END_OF_SENTENCE.split(one) if sentence]
