"""The commands of a page are extracted from all forms of blocks."""

from markdown_commands import find_commands

PAGE = """
# A page

```
picture -> of a node graph
```

Text with `make inline`.

```sh
source .venv/bin/activate   # a comment
$ VAR=1 experiments run a --set x.y=1 # of 'a'
bags compare a \\
  b
python3 -m venv v && source v/bin/activate
made up
```

```python
make('nothing')
```
"""


def test_every_line_of_a_block_with_a_known_program_is_a_command():
    commands = find_commands(PAGE, {'bags', 'source'})
    assert [one.text for one in commands] == [
        'source .venv/bin/activate',
        'VAR=1 experiments run a --set x.y=1',
        'bags compare a b',
        'python3 -m venv v',
        'source v/bin/activate',
        'made up',
    ]
    assert commands[1].words == ['experiments', 'run', 'a', '--set', 'x.y=1']
    assert {one.block for one in commands} == {0}


def test_drawings_contain_no_commands():
    assert find_commands(PAGE, {'ros2'}) == []
