"""The block on topological maps of docs/mapping.md, run in a room."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pflut.mapping.topological_map import TopologicalMap

PAGE = Path(__file__).parents[1] / "docs" / "mapping.md"
SECTION = PAGE.read_text(encoding="utf-8").split("\n## A topological map\n")[1]


@pytest.mark.usefixtures("own_folder")
def test_the_block_runs(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    block = re.search(r"^```python\n(.*?)^```", SECTION, re.MULTILINE | re.DOTALL)
    assert block is not None
    exec(block[1], names)
    assert len(TopologicalMap.load("map.graphml")) == len(names["nodes"])  # type: ignore[arg-type]
    lines = capsys.readouterr().out.splitlines()
    assert "places, the largest of the images" in lines[0]
    assert len(lines) == 1 + len(names["way"][1:]) + len(names["drive"])  # type: ignore
