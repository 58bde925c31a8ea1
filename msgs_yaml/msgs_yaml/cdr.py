"""Write what the fast messages consist of as CDR (XCDR1, little endian): texts and float64.

Alignment counts from the end of the 4-byte encapsulation header; padding is 0, while a serialiser
may leave there what was in memory.
"""

import struct
from collections.abc import Sequence

ENCAPSULATION = b'\x00\x01\x00\x00'
STAMP = struct.Struct('<iI')
STAMP_AT = len(ENCAPSULATION)
_UINT32 = struct.Struct('<I')
_FLOAT64_BYTES = 8


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
