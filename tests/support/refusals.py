"""Requests that are refused."""

import pytest

from precision_pin.base.errors import InputError


def check_refused(*rows, **named):
    """Each row: a pattern of the message, a function and its arguments; those by name are given to all."""
    for message, function, *given in rows:
        with pytest.raises(InputError, match=message):
            function(*given, **named)
