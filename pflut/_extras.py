"""Packages that only some of pflut needs: the extras of its installation."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def require(module: str, *, extra: str, what: str) -> ModuleType:
    """Import a package that not every installation has, or say how to get it.

    Parameters
    ----------
    module : str
        To import: "scipy.sparse".
    extra : str
        Of pflut, that brings it.
    what : str
        Needs it: a function, an argument.

    Returns
    -------
    module

    Raises
    ------
    ImportError
        Naming the extra, if it is not installed.
    """
    package = module.partition(".")[0]
    try:
        import_module(package)
        return import_module(module)
    except ImportError:
        raise ImportError(
            f"{what}: expected {package}, got none; pip install 'pflut[{extra}]'"
        ) from None
