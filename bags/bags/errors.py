"""Errors and warnings of this package; each message is one line for a person."""

from msgs_yaml.strict_yaml import InputError

# a bag that cannot be written, read or repaired; who catches it also gets mistakes in YAML files,
# scenarios and parameters, which a run is made of
BagError = InputError


class DamagedBagWarning(UserWarning):
    """A bag was read up to its first damage; the message says where that is."""


class InvalidMessagesWarning(UserWarning):
    """Messages of a bag break the contract; the message says which were left out."""


class OlderRunWarning(UserWarning):
    """A run lacks what today's controller needs; the message says what was assumed."""
