"""The tables of a study in its folder, one file each, and those of replicates on the way to them.

tuned.parquet    the weights that each search has chosen, and their cost
trials.parquet   every point of the searches
drives.parquet   every drive: those that judge (`judged`), and those of the searches
picture.parquet  the draws from which the nearest to the paper's picture are taken

A replicate that has ended has the first three in its own folder, beside the records of its drives,
until `pack` adds them to those of the study. Only these are decided: nobody looks at a study that
goes on.
"""

import os
import shutil
from pathlib import Path

import pandas as pd

from bags.errors import BagError

TABLES = ('tuned', 'trials', 'drives')  # by replicate
PICTURE = 'picture'


def part(folder: Path, number: int) -> Path:
    """Return the folder of a replicate."""
    return folder / f'replicate_{number:02}'


def read(folder: Path, name: str) -> pd.DataFrame:
    """Return a table of a study. Raises BagError for a folder without it."""
    path = folder / f'{name}.parquet'
    try:
        return pd.read_parquet(path)
    except OSError as error:
        raise BagError(
            f'{path}: {error.strerror or "cannot be read"}; `experiments study run` writes it when '
            'the study has ended'
        ) from None


def packed(folder: Path, name: str) -> set[int]:
    """Return the replicates in a table of a study, none where there is no table."""
    path = folder / f'{name}.parquet'
    return (
        set(pd.read_parquet(path, columns=['replicate'])['replicate']) if path.is_file() else set()
    )


def collect(folder: Path, name: str, count: int) -> pd.DataFrame:
    """Return the rows of a table, and those of replicates 1 to `count` that are not in it yet."""
    kept = packed(folder, name)
    folders = [folder] if kept else []
    folders += [part(folder, number) for number in range(1, count + 1) if number not in kept]
    return pd.concat([read(one, name) for one in folders], ignore_index=True)


def pack(folder: Path, count: int) -> None:
    """Put the rows of replicates 1 to `count` into the tables, and remove their folders.

    An interrupted call is made good by the next one.
    """
    parts = [own for number in range(1, count + 1) if (own := part(folder, number)).is_dir()]
    for name in TABLES if parts else ():
        write(collect(folder, name, count), folder, name)
    for own in parts:
        shutil.rmtree(own)


def write(frame: pd.DataFrame, folder: Path, name: str) -> None:
    """Write a table, whole or not at all."""
    # numbers that hardly repeat take a fifth less, byte by byte, than in a dictionary
    counts = frame.select_dtypes('float').agg(['nunique', 'count'])
    split = [column for column, (kinds, size) in counts.items() if 2 * kinds > size]
    path = folder / f'{name}.parquet'
    frame.to_parquet(
        path.with_suffix('.part'),
        compression='zstd',
        compression_level=19,
        use_dictionary=[column for column in frame if column not in split],
        column_encoding=dict.fromkeys(split, 'BYTE_STREAM_SPLIT'),
    )
    os.replace(path.with_suffix('.part'), path)
