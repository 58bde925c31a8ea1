"""Values of diagnostics as text, and back to what they were: number, truth or word."""

import numpy as np

_TRUTHS = {'True': True, 'False': False}


def write(value: float | int | str | bool) -> str:
    """Return a text that `read` turns into the same value.

    Raises ValueError for a word that would come back as something else, such as '12'.
    """
    if isinstance(value, str):
        if not isinstance(read(value), str):
            raise ValueError(f'the word {value!r} would be read as a number or truth')
        return value
    plain = value.item() if isinstance(value, np.generic) else value
    return repr(plain)


def read(text: str) -> float | int | str | bool:
    """Return the number or truth that a text spells, else the text; infinity beyond a float."""
    if text in _TRUTHS:
        return _TRUTHS[text]
    for kind in (int, float):
        try:
            number = kind(text)
            float(number)
        except (ValueError, OverflowError):
            continue
        return number
    return text
