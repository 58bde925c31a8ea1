"""Check for rejected messages."""

import pytest

from msgs_yaml.decode import DecodeError


@pytest.fixture
def rejects():
    """Return rejects(decoder, message, error): check the DecodeError of a message."""

    def check(decoder, message, error):
        with pytest.raises(DecodeError, match=error):
            decoder(message)

    return check
