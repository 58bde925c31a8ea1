"""How a message is refused."""

import pytest

from msgs_yaml.decode import DecodeError


@pytest.fixture
def refused():
    """Return refused(decoder, message, says): it must be, and the error must say so."""

    def check(decoder, message, says):
        with pytest.raises(DecodeError, match=says):
            decoder(message)

    return check
