"""Import a package's public names when they are first used, so that importing it is fast."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy(
    package: str, names: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Make a package's ``__getattr__``, ``__dir__`` (PEP 562) and ``__all__``.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    names : mapping of str to str
        Public name to the module below the package that holds it.

    Returns
    -------
    getattr, dir, all : callable, callable, list of str
        To be assigned to those names. Type checkers do not see through them: the package also
        imports the names under ``if TYPE_CHECKING``.
    """

    def find(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{names[name]}"), name)

    return find, lambda: sorted(names), sorted(names)
