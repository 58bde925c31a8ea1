"""Errors and warnings of this package; each message is one line for a person."""


class BagError(Exception):
    """A bag cannot be written, read or repaired; the message says which, why and what helps."""


class DamagedBagWarning(UserWarning):
    """A bag was read up to its first damage; the message says where that is."""


class InvalidMessagesWarning(UserWarning):
    """Messages of a bag break the contract; the message says which were left out."""


class OlderRunWarning(UserWarning):
    """A run lacks what today's controller needs; the message says what was assumed."""
