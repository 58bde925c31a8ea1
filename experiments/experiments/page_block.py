"""Generated blocks of Markdown pages: the text between <!-- NAME --> and <!-- /NAME -->."""

from pathlib import Path

from bags.errors import BagError


def marks(name: str) -> tuple[str, str]:
    """Return the comments that begin and end a block."""
    return f'<!-- {name} -->', f'<!-- /{name} -->'


def split(file: Path, name: str) -> tuple[str, str, str]:
    """Return a file's text before, between and after the comments. Raises BagError."""
    begin, end = marks(name)
    text = file.read_text(encoding='utf-8')
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise BagError(f'{file}: needs the lines {begin} and {end}, once each and in this order')
    before, _, rest = text.partition(begin)
    between, _, after = rest.partition(end)
    return before + begin, between, end + after


def replace(file: Path, name: str, content: str) -> None:
    """Replace the text between the comments of a file. Raises BagError."""
    before, _, after = split(file, name)
    file.write_text(before + content + after, encoding='utf-8')
