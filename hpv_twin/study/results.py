"""The file of a study: a CSV that is written as the work goes on, and can be gone on with."""
from __future__ import annotations

import csv
import io
import itertools
import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

MARK = '# hpv_twin '
BLOCK = 20_000  # rows read at a time
TEXT = ('regime',)  # columns that are no numbers


class StudyFileError(ValueError):
    """A results file that cannot be used: the message names it and says what to do."""


class Results:
    """
    Rows of figures on disk, appended in order.

    Line 1 says, after a `#`, which study this is (JSON), line 2 names the columns. A file of the
    same study is gone on with where it ends; of another study it is refused. A name that ends with
    .parquet is written as Parquet once all rows are there; until then they are in NAME.part.
    """

    def __init__(self, path: Path, study: dict, columns: list[str]):
        self.path = Path(path)
        self.columns = columns
        self.is_parquet = self.path.suffix == '.parquet'
        if self.is_parquet:
            # Missing now, not when the work is done.
            import pyarrow.parquet  # noqa: F401
        self._working = self.path.with_name(f'{self.path.name}.part') if self.is_parquet \
            else self.path
        self._header = f'{MARK}{json.dumps(study, ensure_ascii=False)}\n'
        self._complete = self.is_parquet and self.path.exists()
        try:
            if self._complete:
                self._hold_against(self._parquet_header(), self.path)
            elif self._working.exists() and self._working.stat().st_size:
                self._hold_against(first_line(self._working), self._working)
                self.rows = whole_rows(self._working)
            else:
                self.rows = 0
                self._working.write_text(f'{self._header}{",".join(columns)}\n', encoding='utf-8')
        except OSError as error:
            raise StudyFileError(f'{error.filename}: {error.strerror}') from None

    def _hold_against(self, header, path):
        if header != self._header:
            raise StudyFileError(f'{path} holds {difference(header, self._header)}. Nothing was '
                                 'written: name another file with -o, or remove it')

    def append(self, block: dict) -> None:
        """Write one more block of rows, and have it on disk."""
        text = io.StringIO()
        write = csv.writer(text, lineterminator='\n')
        columns = [block[name].tolist() for name in self.columns]
        write.writerows(zip(*columns, strict=True))
        with open(self._working, 'a', encoding='utf-8', newline='') as file:
            file.write(text.getvalue())
        self.rows += len(columns[0])

    def count(self) -> int:
        """Count the rows that are there by reading; a row cut short is cut off."""
        if not self._complete:
            self.rows = whole_rows(self._working)
        return self.rows

    def blocks(self) -> Iterator[dict[str, np.ndarray]]:
        """Read the rows that are there, at most BLOCK of them at a time."""
        if not self._complete:
            yield from read_blocks(self._working)
            return
        import pyarrow.parquet
        for batch in pyarrow.parquet.ParquetFile(self.path).iter_batches(BLOCK):
            yield {name: batch[name].to_numpy(zero_copy_only=False) for name in self.columns}

    def finish(self) -> None:
        """Say that all rows are there: Parquet is written now, a block at a time."""
        if not self.is_parquet or self._complete:
            return
        import pyarrow
        import pyarrow.parquet
        schema = pyarrow.schema(
            [(name, pyarrow.string() if name in TEXT else pyarrow.float64())
             for name in self.columns], {'hpv_twin': self._header})
        writing = self.path.with_name(f'{self.path.name}.writing')
        with pyarrow.parquet.ParquetWriter(writing, schema) as file:
            for block in self.blocks():
                file.write_table(pyarrow.table(block, schema))
        os.replace(writing, self.path)
        os.unlink(self._working)

    def _parquet_header(self):
        import pyarrow.parquet
        try:
            metadata = pyarrow.parquet.read_schema(self.path).metadata or {}
        except (OSError, pyarrow.ArrowInvalid):
            return 'no Parquet'
        self.rows = pyarrow.parquet.read_metadata(self.path).num_rows
        return metadata.get(b'hpv_twin', b'').decode()


def write_whole(path: Path, study: dict, columns: dict) -> None:
    """Write a results file at one blow: whoever reads it finds the old one or the new one."""
    writing = path.with_name(f'{path.name}.writing')
    writing.unlink(missing_ok=True)
    Results(writing, study, list(columns)).append(columns)
    os.replace(writing, path)


def difference(there: str, here: str) -> str:
    """Say in what two studies differ, by their headers."""
    if not there.startswith(MARK):
        return 'no study'
    try:
        there, here = (json.loads(header[len(MARK):]) for header in (there, here))
    except ValueError:
        return 'no study'
    there, here = ({**study, **study.get('design', {}), 'design': None} for study in (there, here))
    names = [name for name in {**there, **here} if there.get(name) != here.get(name)]
    return 'another study: there ' + ', '.join(
        f'{name} is {there.get(name)}, here {here.get(name)}' for name in names)


def read_study(path) -> dict:
    """Read which study a results file holds; StudyFileError where it holds none."""
    try:
        header = first_line(path)
        if header.startswith(MARK):
            return json.loads(header.removeprefix(MARK))
    except OSError as error:
        raise StudyFileError(f'{path}: {error.strerror}') from None
    except ValueError:
        pass
    raise StudyFileError(f'{path} holds no study')


def first_line(path) -> str:
    """Return the first line of a file, or something that no study has."""
    try:
        with open(path, encoding='utf-8', newline='') as file:
            return file.readline()
    except UnicodeDecodeError:
        return 'no text'


def whole_rows(path) -> int:
    """Count the rows of a results file; what a killed process left of one is cut off."""
    lines = end = 0
    with open(path, 'rb+') as file:
        for line in file:
            if line.endswith(b'\n'):
                lines, end = lines + 1, end + len(line)
        file.truncate(end)
    if lines < 2:
        raise StudyFileError(f'{path} has no line with the names of its columns: remove it')
    return lines - 2


def read_columns(path) -> dict[str, np.ndarray]:
    """Read the columns of a results file: numbers as floats, regimes as text."""
    blocks = list(read_blocks(path))
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def read_blocks(path) -> Iterator[dict[str, np.ndarray]]:
    """Read a results file some BLOCK rows at a time; one without rows is one empty block."""
    with open(path, encoding='utf-8', newline='') as file:
        file.readline()
        rows = csv.reader(file)
        names = next(rows)
        some = list(itertools.islice(rows, BLOCK))
        while True:
            columns = list(zip(*some, strict=True)) or [()] * len(names)
            yield {name: np.array(values, dtype=str if name in TEXT else float)
                   for name, values in zip(names, columns, strict=True)}
            some = list(itertools.islice(rows, BLOCK))
            if not some:
                return
