"""The command line, run in the tests' process."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Outcome(NamedTuple):
    """What a command ended with."""

    code: int
    out: str
    err: str


Run = Callable[..., Outcome]
"""The fixture ``run``: takes the arguments."""


def refused(outcome: Outcome, *words: str) -> None:
    """Check that bad input ended in one line that names what was wrong."""
    assert outcome.code == 1
    lines = outcome.err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("pflut: error: "), outcome.err
    for word in words:
        assert word in outcome.err
