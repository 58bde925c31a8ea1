"""Links of pages to files outside docs/: pages of their own, or downloads."""

import outside_links
import pytest


@pytest.fixture
def docs(tmp_path):
    (tmp_path / 'docs/howto').mkdir(parents=True)
    (tmp_path / 'bench').mkdir()
    (tmp_path / 'bench/table.md').write_text('[back](../docs/plant.md#axes) [next](more.md)')
    (tmp_path / 'bench/more.md').write_text('# More')
    (tmp_path / 'bench/data.yaml').write_text('a: 1')
    return tmp_path / 'docs'


def rewrite(docs, text, found=None):
    return outside_links.rewrite(
        docs, docs / 'howto/page.md', 'howto/page.md', text, found or set()
    )


def test_a_link_inside_docs_stays(docs):
    text = 'see [plant](../plant.md#axes) and ![figure](figure.png), [web](https://a.example/b)'
    assert rewrite(docs, text) == text


def test_a_link_to_markdown_outside_docs_leads_to_its_page_on_the_site(docs):
    found = set()
    text = outside_links.rewrite(
        docs, docs / 'howto/page.md', 'howto/page.md', '[t](../../bench/table.md#rows)', found
    )
    assert text == '[t](../generated/repository/bench/table.md#rows)'
    assert found == {docs.parent / 'bench/table.md'}


def test_a_link_to_another_file_outside_docs_is_a_download_of_it(docs):
    assert rewrite(docs, '[d](../../bench/data.yaml)') == '[d](../../bench/data.yaml)'


def test_code_is_left_alone(docs):
    text = '```\n[t](../../bench/table.md)\n```\n'
    assert rewrite(docs, text) == text


def test_linked_pages_are_written_with_those_that_they_link_to(docs):
    (docs / 'howto/page.md').write_text('[t](../../bench/table.md)')
    written = outside_links.write_pages(docs)
    assert [path.name for path in written] == ['more.md', 'table.md']
    page = docs / 'generated/repository/bench/table.md'
    assert page.read_text() == '[back](../../../plant.md#axes) [next](more.md)'


def test_a_page_that_is_as_it_should_be_is_not_written_again(docs):
    (docs / 'howto/page.md').write_text('[t](../../bench/table.md)')
    outside_links.write_pages(docs)
    page = docs / 'generated/repository/bench/table.md'
    before = page.stat().st_mtime_ns
    outside_links.write_pages(docs)
    assert page.stat().st_mtime_ns == before
