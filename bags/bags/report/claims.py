"""The claims of the paper with their verdicts, as `claims.json` holds them."""

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from bags.errors import BagError

FILE = 'claims.json'


class Claim(NamedTuple):
    """One claim: what the paper says, what came out here, and why; texts for a person."""

    claim: str
    paper: str
    ours: str
    verdict: str  # reproduced, partly, not, not decided here
    cause: str
    reasons: Mapping[str, str] = MappingProxyType({})  # by the letters behind the verdict


TEXTS = tuple(name for name in Claim._fields if name not in Claim._field_defaults)


def beside(folder: Path) -> Path | None:
    """Return the claims.json in `folder`, None where there is none."""
    file = folder / FILE
    return file if file.is_file() else None


def load(file: Path) -> list[Claim]:
    """Read a list of {claim, paper, ours, verdict, cause}; BagError says what is wrong with it.

    `reasons` may be added: what the letters behind a verdict mean. Further keys are left alone.
    """
    try:
        found = json.loads(file.read_text())
    except (OSError, ValueError) as error:
        raise BagError(f'{file}: no claims can be read: {error}') from None
    if not isinstance(found, list):
        raise BagError(f'{file}: must be a list of claims, is a {type(found).__name__}')
    return [_claim(file, k, one) for k, one in enumerate(found)]


def _claim(file, k, one):
    missing = [key for key in TEXTS if not isinstance(one, dict) or key not in one]
    if missing:
        raise BagError(f'{file}: claim {k} lacks {", ".join(missing)}')
    reasons = one.get('reasons', {})
    if not isinstance(reasons, dict) or not all(isinstance(it, str) for it in reasons.values()):
        raise BagError(f'{file}: claim {k}: reasons: must be a mapping of texts, is {reasons!r}')
    return Claim(*(_text(one[key]) for key in TEXTS), reasons)


def _text(value: Any):
    if value is None:
        return '–'
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
