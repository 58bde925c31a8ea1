"""The blocks of a page, and the reader who does what they say."""

import os

import pytest
import tutorial_page
from tutorial_page import Session, find_blocks, missing_line

FENCE = '```'


def page(text):
    return text.replace('~~~', FENCE)


@pytest.fixture
def do(tmp_path):
    """Return a function that does what a page says, in one session."""
    with Session(tmp_path, dict(os.environ)) as reader:
        yield lambda text: [reader.do(block) for block in find_blocks(page(text))]


def test_blocks_have_the_kind_of_their_comment_or_language():
    text = """
<!-- file: a.yaml -->
~~~yaml
a: 1
~~~
~~~sh
cat a.yaml
~~~
~~~text
a: 1
~~~
<!-- exit code: 2 -->
~~~sh
ls b
~~~
<!-- in a.yaml, after: a -->
~~~yaml
b: 2
~~~
<!-- not run: has no printer -->
~~~sh
lpr a.yaml
~~~
"""
    kinds = [(b.kind, b.value) for b in find_blocks(page(text))]
    assert kinds == [
        ('file', 'a.yaml'),
        ('run', ''),
        ('output', ''),
        ('exit code', '2'),
        ('in', 'a.yaml, after: a'),
        ('not run', 'has no printer'),
    ]
    assert find_blocks(page(text))[1].line == 6


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('~~~yaml\na: 1\n~~~\n', 'line 1: no kind of block: yaml'),
        ('~~~\nls\n~~~\n', 'line 1: no kind of block: '),
        ('<!-- fiel: a -->\n~~~sh\nls\n~~~\n', 'line 2: no kind of block: fiel: a'),
        ('~~~text\na\n~~~\n', 'line 1: output, but no command above it'),
    ],
)
def test_a_block_without_meaning_is_refused(text, reason):
    with pytest.raises(ValueError, match=reason):
        find_blocks(page(text))


def test_an_excerpt_is_in_its_order_with_any_blanks_and_anything_for_dots():
    printed = 'first  1.25 m\nsecond\n  third   line of 3\n'
    assert missing_line('first 1... m\n...\nthird ... 3', printed) is None
    assert missing_line('third\nsecond', printed) == 'second'
    assert missing_line('second 2', printed) == 'second 2'


def test_shell_blocks_share_folder_and_variables_python_blocks_their_names(do, tmp_path):
    do("""
~~~sh
mkdir deep
cd deep
export COLOUR=blue
~~~
~~~sh
echo $COLOUR > here
~~~
~~~python
x = 20
~~~
~~~python
print(x + 1, open('deep/here').read())
~~~
~~~text
21 blue
~~~
""")
    assert (tmp_path / 'deep/here').read_text() == 'blue\n'


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('~~~sh\nfalse\n~~~\n', 'exit code 1 of'),
        ('~~~sh\nfalse\ntrue\n~~~\n', 'exit code 1 of'),
        ('~~~sh\nfalse | cat\n~~~\n', 'exit code 1 of'),
        ('<!-- exit code: 1 -->\n~~~sh\ntrue\n~~~\n', 'exit code 0 of'),
        ('<!-- on the wall clock -->\n~~~sh\nexit 2\n~~~\n', 'exit code 2 of'),
        ('~~~sh\necho Traceback\n~~~\n', 'Traceback'),
        ('~~~sh\necho a\n~~~\n~~~text\nb\n~~~\n', "no line 'b' in\na"),
        ('~~~python\n1 / 0\n~~~\n', 'ZeroDivisionError'),
        ('<!-- in gone.py, after: x -->\n~~~python\ny\n~~~\n', 'gone.py'),
    ],
)
def test_what_does_not_work_fails(do, text, reason):
    with pytest.raises((AssertionError, FileNotFoundError), match=reason):
        do(text)


def test_a_terminal_runs_beside_the_others_until_the_end(tmp_path):
    text = """
<!-- terminal -->
~~~sh
python3 -u -c "import signal; print('ready'); signal.pause()"
~~~
~~~text
ready
~~~
~~~sh
echo domain $ROS_DOMAIN_ID
~~~
~~~text
domain ...
~~~
"""
    with Session(tmp_path, dict(os.environ)) as reader:
        for block in find_blocks(page(text)):
            reader.do(block)
        (terminal,) = reader.terminals
        assert terminal.poll() is None
    assert terminal.poll() is not None


def test_a_terminal_that_ends_with_an_error_fails_at_the_end(tmp_path):
    (block,) = find_blocks(page('<!-- terminal -->\n~~~sh\nsh -c "exit 3"\n~~~\n'))
    reader = Session(tmp_path, dict(os.environ))
    reader.do(block)
    reader.terminals[0].wait(60)
    with pytest.raises(AssertionError, match='exit code 3'):
        reader.close()


def test_the_kinds_of_the_docstring_are_those_that_are_known():
    comments = [
        line.split(' -->')[0].removeprefix('    <!-- ')
        for line in tutorial_page.__doc__.splitlines()
        if line.startswith('    <!-- ')
    ]
    assert len(comments) > 5
    for comment in comments:
        assert tutorial_page.KIND.fullmatch(comment), comment
