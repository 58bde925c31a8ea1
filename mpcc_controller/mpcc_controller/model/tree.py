"""Nested named tuples to flat vectors and back, so that no index is ever typed."""


def leaves(tree) -> list:
    """Return the values of a nested tuple in order."""
    if isinstance(tree, tuple):
        return [leaf for branch in tree for leaf in leaves(branch)]
    return [tree]


def names(tree, prefix='') -> tuple[str, ...]:
    """Return the dotted names of the leaves; unnamed tuples count from 0."""
    if not isinstance(tree, tuple):
        return (prefix,)
    fields = getattr(tree, '_fields', range(len(tree)))
    found = []
    for field, branch in zip(fields, tree):
        found += names(branch, f'{prefix}.{field}' if prefix else str(field))
    return tuple(found)


def fill(tree, values):
    """Return `tree` with its leaves replaced by `values`, an iterable of the right length."""
    remaining = iter(values)
    full = _fill(tree, remaining)
    if next(remaining, None) is not None:
        raise ValueError('more values than leaves')
    return full


def _fill(tree, remaining):
    if not isinstance(tree, tuple):
        return next(remaining)
    branches = [_fill(branch, remaining) for branch in tree]
    return type(tree)(*branches) if hasattr(tree, '_fields') else tuple(branches)
