"""Load the dataset that a verb was given, with a bar where that takes long."""

from __future__ import annotations

from pathlib import Path

from pflut.cli.progress import Bars
from pflut.datasets.base import Dataset
from pflut.datasets.registry import SIMULATED_HOME, load_dataset
from pflut.likelihood.table import LikelihoodTable
from pflut.replay.pipeline import make_table


def load(name: str, references: str | None, *, progress: Bars) -> Dataset:
    """Load a dataset by name or folder; the simulated home is rendered at its first use.

    Parameters
    ----------
    name : str
    references : str, optional
        See `pflut.datasets.Dataset.with_references`.
    progress : Bars

    Returns
    -------
    Dataset
    """
    if name == SIMULATED_HOME and not Path(name).is_dir():
        from pflut.datasets.simulated_home import load_simulated_home

        home = load_simulated_home(progress=progress.stage("rendering"))
        return home if references is None else home.with_references(references)
    return load_dataset(name, references=references)


def load_table(path: Path | None, bins: int, *, progress: Bars) -> LikelihoodTable:
    """Load a table from a file, or give the simulator's; learning it takes some seconds, once.

    Parameters
    ----------
    path : Path, optional
    bins : int
        Of the simulator's table.
    progress : Bars

    Returns
    -------
    LikelihoodTable
    """
    if path is not None:
        return LikelihoodTable.load(path)
    return make_table(bins, progress=progress)
