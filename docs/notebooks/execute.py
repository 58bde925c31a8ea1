"""Execute the notebooks of this folder and keep their output in them: `make notebooks`.

Outputs are committed: the site and every viewer of notebooks show them, and building the site
executes nothing. A test executes the notebooks again and keeps nothing.
"""

import argparse
import base64
import io
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent
CELL_S = 300  # wall time of one cell, and of the start of Python
COLOURS = 128  # of a picture: a quarter of the size, and no difference that one sees
PNG = 'image/png'
VOLATILE = ('execution', 'language_info')  # metadata that differ between machines and calls


def execute(file: Path, folder: Path = FOLDER) -> nbformat.NotebookNode:
    """Return a notebook, executed in a folder, without what differs from call to call.

    Raises nbclient.exceptions.CellExecutionError for a cell that fails.
    """
    notebook = nbformat.read(file, as_version=4)
    NotebookClient(
        notebook,
        kernel_name='python3',
        timeout=CELL_S,
        startup_timeout=CELL_S,
        resources={'metadata': {'path': str(folder)}},
    ).execute()
    for part in (notebook, *notebook.cells):
        for name in VOLATILE:
            part.metadata.pop(name, None)
    for cell in notebook.cells:
        for output in cell.get('outputs', ()):
            data = output.get('data', {})
            if PNG in data:
                data[PNG] = _reduce_colours(data[PNG])
    return notebook


def _reduce_colours(encoded: str) -> str:
    picture = Image.open(io.BytesIO(base64.b64decode(encoded))).convert('RGB')
    stream = io.BytesIO()
    picture.quantize(COLOURS).save(stream, format='PNG', optimize=True)
    return base64.b64encode(stream.getvalue()).decode()


def main() -> None:
    """Execute the given notebooks, or all."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('files', nargs='*', type=Path, metavar='FILE.ipynb')
    for file in parser.parse_args().files or sorted(FOLDER.glob('*.ipynb')):
        print(file.name, flush=True)
        nbformat.write(execute(file), file)


if __name__ == '__main__':
    main()
