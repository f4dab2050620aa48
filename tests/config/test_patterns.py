"""A pattern that a text must match, in words."""

import pytest

from config.patterns import END_POINT, TLS_END_POINT, in_words


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        (r"^[A-Za-z0-9_-]{1,32}$", "1 to 32 letters, digits, '_' and '-'"),
        (r"^[A-Za-z0-9_.-]{1,64}$", "1 to 64 letters, digits, '_', '.' and '-'"),
        (TLS_END_POINT, "tls/HOST:PORT, such as tls/192.168.1.5:7448"),
        (END_POINT, "PROTOCOL/HOST:PORT, such as tcp/127.0.0.1:7447"),
        (r"^a+$", "a text that matches ^a+$"),
    ],
)
def test_a_pattern_is_told_in_words(pattern, words):
    assert in_words(pattern) == words
