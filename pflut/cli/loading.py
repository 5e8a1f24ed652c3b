"""Load the dataset that a verb was given, with a bar where that takes long."""

from __future__ import annotations

from pathlib import Path

from pflut.cli.progress import Bars
from pflut.datasets.base import Dataset
from pflut.datasets.registry import SIMULATED_HOME, load_dataset


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
