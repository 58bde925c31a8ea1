"""What can go wrong with a bag, said in one line for a person."""


class BagError(Exception):
    """A bag cannot be written, read or repaired; the message says which, why and what helps."""


class DamagedBagWarning(UserWarning):
    """A bag was read up to the place where it is damaged; the message says where that is."""


class OlderRunWarning(UserWarning):
    """A run knows less than today's controller asks for; the message says what was assumed."""
