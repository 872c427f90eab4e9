"""Content of files, changed at some places."""

import re

from hypothesis import strategies as st

NUMBERS = ["nan", "-inf", "1e39", "1e308", "-0.0", "0", "-1", "2147483648", "9" * 40]
ODD = ["'x'", "true", "[]", "{}", "[[]]", "1979-05-27", "\\", "\0"]
HOW = ("flip", "flip", "flip", "swap", "swap", "swap", "insert", "delete", "cut")
EIGHT = [b"\xff" * 8, bytes(8), *((2**power).to_bytes(8, "little") for power in (20, 31, 40, 63))]


@st.composite
def mutations(draw, original):
    """Return bytes with up to four places, which may be anywhere, changed or cut off."""
    content, anywhere = bytearray(original), draw(st.randoms(use_true_random=True))
    for _ in range(draw(st.integers(1, 4))):
        place = anywhere.randint(0, len(content))
        how = draw(st.sampled_from(HOW))
        if how == "insert":
            content[place:place] = draw(st.binary(max_size=3))
        elif how == "delete":
            del content[place : place + draw(st.integers(1, 20))]
        elif how == "cut":
            del content[place:]
        elif how == "swap":
            content[place : place + 8] = draw(st.binary(min_size=8, max_size=8) | st.sampled_from(EIGHT))
        elif place < len(content):
            content[place] ^= 1 << draw(st.integers(0, 7))
    return bytes(content)


@st.composite
def reworded_texts(draw, text):
    """Return a text in which some names stand for other names of it, and numbers for other or odd values."""
    parts, anywhere = re.split(r"([\w.+-]+)", text), draw(st.randoms(use_true_random=True))
    words = parts[1::2]
    values = [word for word in words if _is_number(word)] + NUMBERS + ODD
    names = [word for word in words if not _is_number(word)]
    for _ in range(draw(st.integers(1, 3))):
        place = anywhere.randrange(len(words))
        words[place] = anywhere.choice(values if _is_number(words[place]) else names)
    parts[1::2] = words
    return "".join(parts).encode()


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True
