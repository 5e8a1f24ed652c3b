"""Read a table of either kind."""

from __future__ import annotations

import os

from pflut.likelihood import dense
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.storage import read_table
from pflut.likelihood.table import LikelihoodTable


def load_table(path: str | os.PathLike[str]) -> LikelihoodTable | DenseTable:
    """Read a likelihood table from its file.

    Parameters
    ----------
    path : path

    Returns
    -------
    LikelihoodTable or DenseTable

    Raises
    ------
    ValueError
        If the file is truncated, of another version, or holds non-finite numbers.
    FileNotFoundError
        If there is no such file.
    """
    if read_table(path)[0] == dense.KIND:
        return DenseTable.load(path)
    return LikelihoodTable.load(path)
