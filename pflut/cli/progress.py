"""Progress bars on stderr, where that is a terminal."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any

_UNITS = {
    "table": "corr",
    "references": "image",
    "images": "image",
    "features": "image",
    "pairs": "pair",
}


class Bars:
    """One bar after another, a stage each; to be used as a context."""

    def __init__(self) -> None:
        self._stage = ""
        self._bar: Any = None

    def __enter__(self) -> Bars:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage is."""
        from tqdm import tqdm

        if stage != self._stage:
            self.close()
            self._stage = stage
            unit = _UNITS.get(stage, "it")
            # disable=None: no bar where stderr is no terminal
            self._bar = tqdm(
                total=total, desc=stage, unit=unit, unit_scale=total > 100_000, disable=None
            )
        self._bar.update(done - self._bar.n)

    def stage(self, name: str) -> Callable[[int, int], None]:
        """Give a callable ``(done, total)`` for one stage."""
        return lambda done, total: self(name, done, total)

    def close(self) -> None:
        """End the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
        self._bar, self._stage = None, ""
