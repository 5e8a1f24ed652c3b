"""What a camera's parameters may be: one check for Python arguments and for TOML values."""

from __future__ import annotations

import math
from dataclasses import Field, field, fields
from numbers import Integral, Real
from typing import Any

ANGLE = "angle"
LENGTHS = "lengths"


def angle(default: float) -> Any:
    """Declare a dataclass field that is an angle: radians in Python, degrees in TOML."""
    return field(default=default, metadata={ANGLE: True})


def coefficients(*lengths: int) -> Any:
    """Declare a tuple of zeros of the first length; any of the lengths is accepted.

    No length at all declares a field without a default and with any length but zero.
    """
    if not lengths:
        return field(metadata={LENGTHS: ()})
    return field(default=(0.0,) * lengths[0], metadata={LENGTHS: lengths})


def is_angle(declared: Field[Any]) -> bool:
    """Whether a dataclass field is an angle."""
    return bool(declared.metadata.get(ANGLE, False))


def checked_value(declared: Field[Any], value: Any) -> Any:
    """Check one parameter and return it as the plain Python type of its field.

    Parameters
    ----------
    declared : dataclasses.Field
        Its annotation (a string) and metadata say what is expected.
    value : object

    Returns
    -------
    int, float, bool, str or tuple of float

    Raises
    ------
    ValueError
        One clause without the name: what was expected and what was there.
    """
    kind = declared.type
    if kind == "int":
        if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
            raise ValueError(f"expected a positive integer, got {value!r}")
        return int(value)
    if kind == "float":
        return _finite(value)
    if kind == "bool":
        if not isinstance(value, bool):
            raise ValueError(f"expected true or false, got {value!r}")
        return value
    if kind == "str":
        if not isinstance(value, str):
            raise ValueError(f"expected a text, got {value!r}")
        return value
    return _finite_tuple(declared, value)


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {value!r}")
    return float(value)


def _finite_tuple(declared: Field[Any], value: Any) -> tuple[float, ...]:
    if isinstance(value, str) or not hasattr(value, "__len__"):
        raise ValueError(f"expected a list of numbers, got {value!r}")
    lengths = declared.metadata.get(LENGTHS, ())
    if (lengths and len(value) not in lengths) or len(value) == 0:
        wanted = " or ".join(str(n) for n in lengths) or "at least 1"
        raise ValueError(f"expected {wanted} numbers, got {len(value)}")
    return tuple(_finite(item) for item in value)


def check_fields(instance: Any) -> None:
    """Check every scalar parameter of a frozen dataclass in place.

    Parameters
    ----------
    instance : dataclass
        Its fields are replaced by plain Python values (``np.float64`` becomes ``float``).

    Raises
    ------
    ValueError
        Naming the class, the parameter, what was expected and what was there.
    """
    for declared in fields(instance):
        if declared.name == "mount":
            continue
        try:
            value = checked_value(declared, getattr(instance, declared.name))
        except ValueError as error:
            raise ValueError(f"{type(instance).__name__}: {declared.name}: {error}") from None
        object.__setattr__(instance, declared.name, value)


def check_positive(instance: Any, *names: str) -> None:
    """Check that parameters are greater than zero.

    Raises
    ------
    ValueError
        Naming the class and the first parameter that is not.
    """
    for name in names:
        value = getattr(instance, name)
        if not value > 0.0:
            raise ValueError(
                f"{type(instance).__name__}: {name}: expected more than 0, got {value!r}"
            )
