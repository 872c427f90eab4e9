"""Messages say in the field's terms what is wrong, where, and what to do. `pytest -s` prints them all."""

import re

from messages import help_texts, messages

OURS = re.compile(
    r"\b(is there|goes? on|to go on|so many|anew|amid|beside|(?<!there )is no|are told|of its own"
    r"|is left as it is|which it may not|holds what|no number|none of them)\b"
)
MOST_CHARACTERS = 220


def test_all():
    """Print every message with an example; none has more than one line, or words that need explaining."""
    found, helps = messages(), help_texts()
    for message in found:
        print(f"{message.file}:{message.line} [{message.given_to}] {message.example}")
    for name, text in helps.items():
        print(f"{name}: {text}")
    assert len(found) > 250
    complete = [message for message in found if not message.unknown]
    assert len(complete) >= 0.9 * len(found), "add samples to messages.toml"
    texts = [message.example for message in found] + [text for text in helps.values() if text]
    assert [text for text in texts if OURS.search(text)] == []
    refusals = [message.example for message in found if message.given_to in ("InputError", "OutputError")]
    assert [text for text in refusals if "\n" in text or len(text) > MOST_CHARACTERS] == []
