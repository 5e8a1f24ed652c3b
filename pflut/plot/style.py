"""Colors, figures and how they are saved."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure

from pflut._files import replacing

# M. Okabe, K. Ito, "Color universal design" (2008): told apart by the color-blind
BLUE, VERMILION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#000000", "#8C8C8C"
CYCLE = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, BLACK)
# perceptually uniform, and the same order in grey
COLORMAP = "viridis"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches that makes room for its labels."""
    return Figure(figsize=(width, height), layout="constrained")


def tidy(axes: Axes, *, grid: bool = True) -> None:
    """Take away what carries no data."""
    axes.spines[["top", "right"]].set_visible(False)
    if grid:
        axes.grid(True, color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)


def check_figure_path(path: str | os.PathLike[str]) -> None:
    """Refuse a path that no figure can be written to, before the work of drawing one.

    Raises
    ------
    ValueError
        If the suffix is no format that Matplotlib writes.
    FileNotFoundError
        If the folder does not exist.
    """
    known = FigureCanvasBase.get_supported_filetypes()
    if Path(path).suffix.removeprefix(".").lower() not in known:
        raise ValueError(f"{path}: no format for figures, expected one of {', '.join(known)}")
    if not Path(path).parent.is_dir():
        raise FileNotFoundError(f"{path}: its folder does not exist")


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: int = 150) -> None:
    """Write a figure, atomically, in the format of the path's suffix.

    Parameters
    ----------
    figure : Figure
    path : path
        ``.png``, ``.pdf``, ``.svg``, ...; its folder must exist.
    dpi : int
        Dots per inch of a raster format.

    Raises
    ------
    ValueError
        If the suffix is no format that Matplotlib writes.
    FileNotFoundError
        If the folder does not exist.
    """
    check_figure_path(path)
    suffix = Path(path).suffix.removeprefix(".").lower()
    # without the date, and with names that are no random numbers, the same figure gives the same
    # bytes
    undated = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    with replacing(path) as temporary, rc_context({"svg.hashsalt": "pflut"}):
        figure.savefig(temporary, dpi=dpi, metadata=undated.get(suffix))
