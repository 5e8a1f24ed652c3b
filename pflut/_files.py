"""Write files so that a reader never meets half of one; read tables of numbers strictly."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside ``path`` that takes its place when the block ends well.

    Parameters
    ----------
    path : path
        The file to write. Its folder must exist.

    Yields
    ------
    Path
        A name in the same folder with the same suffix (libraries choose formats by it). When
        the block raises, the temporary file is removed and ``path`` is left as it was.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{target}: its folder does not exist")
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        yield temporary
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file (UTF-8, line feeds) atomically.

    Parameters
    ----------
    path : path
        The file to write. Its folder must exist.
    text : str
        The whole content.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_csv(
    path: str | os.PathLike[str], columns: Sequence[str], rows: Iterable[Sequence[Any]]
) -> None:
    """Write a table with a line of column names, atomically; numbers with all their digits."""
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def write_json(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write a JSON file, atomically; numbers with all their digits."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a JSON file that `write_json` wrote.

    Raises
    ------
    ValueError
        Naming the file, if it is none.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a JSON file: {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a JSON object, got {type(content).__name__}")
    return content


def read_table(
    path: str | os.PathLike[str], columns: int, expected: str, *, separator: str | None = None
) -> tuple[NDArray[np.float64], list[int]]:
    """Read a table of finite numbers; ``#`` starts a comment line.

    Parameters
    ----------
    path : path
        The text file.
    columns : int
        How many numbers a line holds.
    expected : str
        What the error messages say a line should be.
    separator : str, optional
        What stands between the numbers; blanks if not given.

    Returns
    -------
    rows : ndarray of shape (n, columns)
        At least one row.
    lines : list of int
        The number of the line that each row stands on, counted from 1.

    Raises
    ------
    ValueError
        Naming file and line: another number of columns, a value that is no finite number; or an
        empty file.
    """
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = line.split(separator)
        where = f"{path}:{number}"
        if len(words) != columns:
            missing = "timestamp" in expected and len(words) == columns - 1
            hint = " (is the timestamp missing?)" if missing else ""
            raise ValueError(f"{where}: {len(words)} columns{hint}, expected {columns}: {expected}")
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise ValueError(f"{where}: not all numbers, expected {expected}") from None
        if not np.isfinite(values).all():
            raise ValueError(f"{where}: a value is not finite, expected {expected}")
        rows.append(values)
        lines.append(number)
    if not rows:
        raise ValueError(f"{path}: no rows, expected lines of {expected}")
    return np.array(rows), lines


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a UTF-8 text file.

    Raises
    ------
    ValueError
        If the file is not text.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file (UTF-8)") from None


def read_arrays(path: str | os.PathLike[str], kind: str) -> dict[str, NDArray[Any]]:
    """Read all arrays of a `.npz` file, without pickle.

    Parameters
    ----------
    path : path
    kind : str
        What the error message says that the file should be.

    Returns
    -------
    dict of str to ndarray

    Raises
    ------
    ValueError
        Naming the file, if it is no `.npz` file, damaged, or holds objects.
    OSError
        If it cannot be opened.
    """
    # a stream of our own: NumPy leaks the one it opens where a file is broken
    with Path(path).open("rb") as stream:
        try:
            with np.load(stream, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
        # a damaged archive, or a file of another kind, breaks zipfile, zlib and NumPy in a dozen
        # ways, and what they say (to allow pickle, for one) helps nobody
        except Exception:
            raise ValueError(f"{path}: not a {kind} of pflut, or damaged") from None


def checksum(text: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    """Give the SHA-256 of a text and of named arrays, their types and shapes included."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}\n".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


def refuse_rows(
    path: str | os.PathLike[str],
    lines: list[int],
    bad: NDArray[np.bool_],
    message: Callable[[int], str],
) -> None:
    """Raise for the first bad row of a table, naming file and line.

    Parameters
    ----------
    path : path
        The file of the table.
    lines : list of int
        The line of each row, from `read_table`.
    bad : ndarray of shape (n,)
        Which rows are refused.
    message : callable
        Row -> what is wrong with it.

    Raises
    ------
    ValueError
        If a row is bad.
    """
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise ValueError(f"{path}:{lines[row]}: {message(row)}")
