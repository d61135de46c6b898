"""Text from outside: what a terminal would obey is escaped, what is too long is cut, letters stay."""

import pytest

from skinbus.printable import MAX_TEXT, layout, printable, shown_value


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Unterarm ß 前腕 [/red]", "Unterarm ß 前腕 [/red]"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("two\nlines\t\r", r"two\nlines\t\r"),
        ("\x9b2J\x7f", r"\x9b2J\x7f"),
        ("\u202eright to left\u2028", r"\u202eright to left\u2028"),
        ("\udc80", r"\udc80"),
        ("x" * 1000, "x" * MAX_TEXT + "..."),
    ],
)
def test_text_from_outside(text, shown):
    assert printable(text) == shown
    assert printable(printable(text), limit=None) == shown


def test_a_message_of_ours_keeps_its_lines():
    assert layout("a\tb\n  c \x1b[2J") == "a\tb\n  c \\x1b[2J"


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


LARGE = {
    "integer": 10**5000,
    "depth": nested(50_000),
    "string": {"k": "\x1b" * 10**6},
    "list": ["x"] * 10**6,
    "bytes": b"\x00" * 10**6,
}


@pytest.mark.parametrize("kind", LARGE)
def test_a_value_is_shown_in_a_few_words(kind):
    shown = shown_value(LARGE[kind])
    assert shown.isprintable()
    assert len(shown) <= 3 * MAX_TEXT
