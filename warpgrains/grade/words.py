"""Texts for students, in English and French."""

import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

LANGUAGES = ("en", "fr")


class Words(str):
    """An English text that also holds its French translation, given or from french.toml."""

    french: str

    def __new__(cls, english: str, french: str | None = None, /, **values: object) -> "Words":
        """Return the text with the values of its placeholders, which may be Words, too."""
        text = super().__new__(cls, english.format(**values) if values else english)
        template = _french()[english] if french is None else french
        said = {name: in_language(value, "fr") for name, value in values.items()}
        text.french = template.format(**said) if said else template
        return text


def in_language(text: object, language: str) -> str:
    """Return a text in a language of `LANGUAGES`; texts without a translation stay as they are."""
    return str(getattr(text, "french", text) if language == "fr" else text)


def joined(texts: Sequence[Words]) -> Words:
    """Join several texts with commas, in both languages."""
    return Words(", ".join(texts), ", ".join(text.french for text in texts))


@cache
def _french() -> dict[str, str]:
    return tomllib.loads((Path(__file__).parent / "french.toml").read_text())
