"""Write and read what the fast messages consist of as CDR (XCDR1, little endian).

Alignment counts from the end of the 4-byte encapsulation header; padding is 0, while a serialiser
may leave there what was in memory.
"""

import struct
from collections.abc import Sequence

import numpy as np

ENCAPSULATION = b'\x00\x01\x00\x00'
STAMP = struct.Struct('<iI')
STAMP_AT = len(ENCAPSULATION)
_UINT32 = struct.Struct('<I')
_FLOAT64_BYTES = 8


class CdrError(ValueError):
    """Bytes are no such message."""


class Writer:
    """Appends to a serialised message."""

    def __init__(self):
        self.buffer = bytearray(ENCAPSULATION)

    def header(self, frame: str) -> None:
        """Append a std_msgs/Header with an empty stamp."""
        self.buffer += bytes(STAMP.size)
        self.text(frame)

    def text(self, text: str) -> None:
        """Append a string: length with the closing zero, then the bytes."""
        encoded = text.encode() + b'\x00'
        self.count(len(encoded))
        self.buffer += encoded

    def count(self, number: int) -> None:
        """Append the length of a sequence."""
        self._align(_UINT32.size)
        self.buffer += _UINT32.pack(number)

    def floats(self, numbers: Sequence[float]) -> int:
        """Append float64 numbers and return where they begin."""
        self._align(_FLOAT64_BYTES)
        offset = len(self.buffer)
        self.buffer += struct.pack(f'<{len(numbers)}d', *numbers)
        return offset

    def _align(self, size):
        self.buffer += bytes(-(len(self.buffer) - len(ENCAPSULATION)) % size)


class Reader:
    """Reads a serialised message from its beginning; CdrError for what goes beyond its end."""

    def __init__(self, raw: bytes):
        """Take a message with its encapsulation header; CdrError unless it is little endian."""
        if raw[: len(ENCAPSULATION)] != ENCAPSULATION:
            raise CdrError('the message is not little-endian CDR')
        self._raw = raw
        self._at = len(ENCAPSULATION)

    def align(self, size: int) -> int:
        """Go on to the next multiple of `size`; return where in the bytes that is."""
        self._at += -(self._at - len(ENCAPSULATION)) % size
        return self._at

    def skip(self, size: int, alignment: int = 1) -> int:
        """Go past so many bytes, aligned unless they are none; return where they begin."""
        begin = self.align(alignment) if size else self._at
        if begin + size > len(self._raw):
            raise CdrError(f'the message ends at byte {len(self._raw)}')
        self._at = begin + size
        return begin

    def unpack(self, form: struct.Struct, alignment: int) -> tuple:
        """Return the numbers of a struct."""
        return form.unpack_from(self._raw, self.skip(form.size, alignment))

    def count(self) -> int:
        """Return the length of a sequence."""
        return self.unpack(_UINT32, _UINT32.size)[0]

    def text(self) -> str:
        """Return a string; CdrError without its closing zero, UnicodeDecodeError if no UTF-8."""
        size = self.count()
        begin = self.skip(size)
        encoded = bytes(self._raw[begin : begin + size])
        if encoded[-1:] not in (b'', b'\x00'):
            raise CdrError(f'the string at byte {begin} has no end')
        return encoded[:-1].decode()

    def boolean(self) -> bool:
        """Return a truth value; CdrError for what is neither 0 nor 1."""
        value = self._raw[self.skip(1)]
        if value > 1:
            raise CdrError(f'{value} is no truth value')
        return bool(value)

    def floats(self, number: int) -> np.ndarray:
        """Return a view of so many float64."""
        begin = self.skip(_FLOAT64_BYTES * number, _FLOAT64_BYTES)
        return np.frombuffer(self._raw, '<f8', count=number, offset=begin)
