"""The tables' files, of both kinds: round trips, what is refused, what an interrupt leaves."""

from __future__ import annotations

import dataclasses
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pflut.likelihood import dense, table
from pflut.likelihood.axes import ELEVATION_CELLS, PARALLAX_CELLS, RESIDUAL_CELLS
from pflut.likelihood.counts import SHAPE_CELLS
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.files import load_table
from pflut.likelihood.storage import FORMAT, VERSION, _checksum
from pflut.likelihood.table import QUALITY_CELLS, LikelihoodTable
from pflut.simulation.correspondences import CorrespondenceSimulator

Table = LikelihoodTable | DenseTable
KINDS: dict[str, type[Table]] = {table.KIND: LikelihoodTable, dense.KIND: DenseTable}


def arrays_of(kind: str, seed: int = 0) -> dict[str, np.ndarray]:
    """Give what a file of a kind holds, of random numbers."""
    rng = np.random.default_rng(seed)
    if kind == dense.KIND:
        return {"log_ratio": rng.normal(size=(4, 6, 6)).astype(np.float32)}
    return {
        # the last classes are zero, so that the files stay small
        "density": rng.uniform(size=(PARALLAX_CELLS, SHAPE_CELLS, 1)).round(1).astype(np.float32),
        "profile": rng.uniform(size=(ELEVATION_CELLS, RESIDUAL_CELLS + 1)).astype(np.float32),
        "quality": rng.uniform(size=QUALITY_CELLS).astype(np.float32),
        "mismatch": np.array(0.7),
        "bins": np.array(48),
    }


def table_of(kind: str, seed: int = 0) -> Table:
    arrays = arrays_of(kind, seed)
    if kind == dense.KIND:
        return DenseTable(arrays["log_ratio"], {"source": "test"})
    names = ("density", "profile", "mismatch", "quality", "bins")
    return LikelihoodTable(*(arrays[name] for name in names), {"source": "test"})  # type: ignore[arg-type]


def values_of(some: Table) -> dict[str, Any]:
    """Give all that a table is."""
    return {field.name: getattr(some, field.name) for field in dataclasses.fields(some)}


def assert_equal(one: Table, other: Table) -> None:
    assert type(one) is type(other)
    for name, value in values_of(one).items():
        assert np.array_equal(value, getattr(other, name)), name


def stored(path: Path, of: str, **changes: Any) -> Path:
    """Write a table's file, some of its entries changed or left out (None)."""
    names = ("format", "version", "kind", "learned_from", "checksum")
    arrays = arrays_of(of) | {name: v for name, v in changes.items() if name not in names}
    arrays = {name: value for name, value in arrays.items() if value is not None}
    learned_from = changes.get("learned_from", np.array("{}"))
    entries = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "kind": np.array(of),
        "learned_from": learned_from,
        "checksum": np.array(_checksum(str(changes.get("kind", of)), arrays, str(learned_from))),
    }
    entries |= {name: value for name, value in changes.items() if name in names}
    entries |= arrays
    np.savez_compressed(path, **{k: v for k, v in entries.items() if v is not None})
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_stored_table_comes_back(tmp_path: Path, kind: str) -> None:
    path, some = tmp_path / "table.npz", table_of(kind)
    some.save(path)
    for loaded in (KINDS[kind].load(path), load_table(path)):
        assert_equal(loaded, some)
    assert [p.name for p in tmp_path.iterdir()] == ["table.npz"]
    # the name is taken as it is, as a user gave it
    some.save(tmp_path / "table.lut")
    assert (tmp_path / "table.lut").is_file()


@pytest.mark.parametrize("kind", KINDS)
def test_the_helper_writes_what_a_table_reads(tmp_path: Path, kind: str) -> None:
    """Without this the refusals below might be for a reason of the helper's own."""
    loaded = load_table(stored(tmp_path / "table.npz", kind, learned_from=np.array('{"a": 1}')))
    assert loaded.learned_from == {"a": 1}
    assert_equal(dataclasses.replace(loaded, learned_from={"source": "test"}), table_of(kind))


def test_quality_is_optional(tmp_path: Path) -> None:
    path = stored(tmp_path / "table.npz", table.KIND, quality=None)
    loaded = LikelihoodTable.load(path)
    assert loaded.quality is None
    loaded.save(path)
    assert LikelihoodTable.load(path).quality is None
    with np.load(path, allow_pickle=False) as file:
        assert "quality" not in file


def test_learned_tables_say_of_what(
    tmp_path: Path, default_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    for some in (default_table, small_dense_table):
        some.save(tmp_path / "table.npz")
        loaded = load_table(tmp_path / "table.npz")
        assert_equal(loaded, some)
        assert loaded.learned_from["source"] == "simulation"
        expected = dataclasses.asdict(CorrespondenceSimulator())
        assert loaded.learned_from["simulator"] == expected


def test_one_kind_is_not_taken_for_the_other(tmp_path: Path) -> None:
    for kind, other in ((table.KIND, dense.KIND), (dense.KIND, table.KIND)):
        path = stored(tmp_path / "table.npz", other)
        with pytest.raises(
            ValueError, match=rf"table\.npz: a {other} table, expected a {kind} one"
        ):
            KINDS[kind].load(path)
    unknown = stored(tmp_path / "table.npz", table.KIND, kind=np.array("sparse"))
    for load in (LikelihoodTable.load, DenseTable.load, load_table):
        with pytest.raises(ValueError, match="a sparse table, expected a"):
            load(unknown)


def flat(*shape: int) -> np.ndarray:
    return np.zeros(shape, np.float32)


def spoilt(name: str, value: float) -> dict[str, np.ndarray]:
    """Give an array of the residual table's with one number in it."""
    array = arrays_of(table.KIND)[name].copy()
    array.flat[7 % array.size] = value
    return {name: array}


OF_ANY_KIND: dict[str, tuple[dict[str, Any], str]] = {
    "later version": ({"version": np.array(VERSION + 1)}, f"version {VERSION + 1}, expected"),
    "first version": ({"version": np.array(1)}, f"version 1, expected {VERSION}; learn it again"),
    "version that is no number": ({"version": np.array("one")}, "version one, expected"),
    "no version": ({"version": None}, "version None, expected"),
    "another format": ({"format": np.array("recipe")}, "not a pflut likelihood table"),
    "no format": ({"format": None}, "not a pflut likelihood table"),
    "no kind": ({"kind": None}, "without kind"),
    "no checksum": ({"checksum": None}, "without checksum"),
    "no origin": ({"learned_from": None}, "without learned_from"),
    "wrong checksum": ({"checksum": np.array("0" * 64)}, "checksum does not match"),
    "origin that is no JSON": ({"learned_from": np.array("{")}, "learned_from"),
    "origin that is no object": ({"learned_from": np.array("[1]")}, "learned_from"),
    "text among the numbers": ({"more": np.array("text")}, "expected numbers as more"),
    "complex numbers": ({"more": np.array(1j)}, "expected numbers as more"),
    "NaN where nobody looks": ({"more": np.array([0.0, np.nan])}, "not finite"),
    "pickle inside": (
        {"learned_from": np.array([{"a": 1}], dtype=object)},
        "likelihood table of pflut, or damaged",
    ),
}
OF_A_KIND: dict[str, dict[str, tuple[dict[str, Any], str]]] = {
    dense.KIND: {
        "no table": ({"log_ratio": None}, "without log_ratio"),
        "NaN": ({"log_ratio": np.full((2, 4, 4), np.nan, np.float32)}, "not finite"),
        "infinity": ({"log_ratio": np.full((2, 4, 4), np.inf, np.float32)}, "not finite"),
        "flat": ({"log_ratio": flat(4, 4)}, r"\(R, B, B\)"),
        "not square": ({"log_ratio": flat(2, 4, 5)}, r"\(R, B, B\)"),
        "empty": ({"log_ratio": flat(0, 4, 4)}, r"\(R, B, B\)"),
    },
    table.KIND: {
        "no density": ({"density": None}, "without density"),
        "no profile": ({"profile": None}, "without profile"),
        "no mismatch": ({"mismatch": None}, "without mismatch"),
        "no bins": ({"bins": None}, "without bins"),
        "nothing": ({"bins": None, "density": None}, "without bins, density"),
        "NaN": (spoilt("density", np.nan), "not finite"),
        "infinity": (spoilt("profile", np.inf), "not finite"),
        "negative density": (spoilt("density", -1e-3), "density: expected finite numbers"),
        "negative profile": (spoilt("profile", -1.0), "profile: expected finite numbers"),
        "negative quality": (spoilt("quality", -1.0), "quality: expected finite numbers"),
        "density of another shape": (
            {"density": flat(PARALLAX_CELLS, SHAPE_CELLS + 1, 2)},
            "density: expected shape",
        ),
        "density without classes": (
            {"density": flat(PARALLAX_CELLS, SHAPE_CELLS)},
            "density: expected shape",
        ),
        "no class": ({"density": flat(PARALLAX_CELLS, SHAPE_CELLS, 0)}, "density: expected shape"),
        "density that is a number": ({"density": np.array(1.0)}, "density: expected shape"),
        "profile of another shape": (
            {"profile": flat(ELEVATION_CELLS, RESIDUAL_CELLS)},
            "profile: expected shape",
        ),
        "quality of another shape": ({"quality": flat(7)}, "quality: expected shape"),
        "all mismatches": ({"mismatch": np.array(1.0)}, r"mismatch: expected a share in \(0, 1\)"),
        "no mismatches": ({"mismatch": np.array(0.0)}, r"mismatch: expected a share in \(0, 1\)"),
        "many mismatches": ({"mismatch": np.array([0.5, 0.6])}, r"bad\.npz"),
        "grids too small": ({"bins": np.array(3)}, "bins: expected 4 to 1024"),
        "grids too large": ({"bins": np.array(1025)}, "bins: expected 4 to 1024"),
    },
}
BAD_FILES = [
    pytest.param(kind, *case, id=f"{kind}: {name}")
    for kind in KINDS
    for name, case in (OF_ANY_KIND | OF_A_KIND[kind]).items()
]


@pytest.mark.parametrize(("kind", "changes", "message"), BAD_FILES)
def test_a_bad_file_is_refused_by_name(
    tmp_path: Path, kind: str, changes: dict[str, Any], message: str
) -> None:
    path = stored(tmp_path / "bad.npz", kind, **changes)
    for load in (KINDS[kind].load, load_table):
        with pytest.raises(ValueError, match=message) as error:
            load(path)
        assert str(path) in str(error.value)
        assert "\n" not in str(error.value)


LOADERS: list[Callable[[Path], Table]] = [LikelihoodTable.load, DenseTable.load, load_table]


@pytest.mark.parametrize(
    "content", [b"", b"hello", b"PK\x03\x04", pickle.dumps({"table": 1}), b"\x93NUMPY"]
)
@pytest.mark.parametrize("load", LOADERS)
def test_what_is_no_table_at_all(
    tmp_path: Path, load: Callable[[Path], Table], content: bytes
) -> None:
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"other\.npz"):
        load(path)


@pytest.mark.parametrize("load", LOADERS)
def test_a_plain_array_is_no_table(tmp_path: Path, load: Callable[[Path], Table]) -> None:
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros((2, 4, 4), np.float32))
    with pytest.raises(ValueError, match=r"array\.npz"):
        load(tmp_path / "array.npz")


@pytest.mark.parametrize("load", LOADERS)
def test_a_missing_file(tmp_path: Path, load: Callable[[Path], Table]) -> None:
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "none.npz")


@pytest.mark.parametrize("kind", KINDS)
def test_truncated_at_any_length(tmp_path: Path, kind: str) -> None:
    path = stored(tmp_path / "cut.npz", kind)
    content = path.read_bytes()
    step = len(content) // 60
    for length in [*range(0, len(content) - 1, step), len(content) - 1]:
        path.write_bytes(content[:length])
        with pytest.raises(ValueError, match=r"cut\.npz"):
            load_table(path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_byte_is_refused_or_harmless(tmp_path: Path, kind: str) -> None:
    """Wherever it is: in the data, in the names, in the archive's own structure."""
    path = stored(tmp_path / "flip.npz", kind, learned_from=np.array('{"source": "test"}'))
    some, content = table_of(kind), path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for place in rng.permutation(len(content))[:400]:
        broken = bytearray(content)
        broken[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        try:
            loaded = load_table(path)
        except ValueError as error:
            assert "flip.npz" in str(error)
            refused += 1
        else:
            assert_equal(loaded, some)
    assert refused > 200


@pytest.mark.parametrize("kind", KINDS)
def test_an_interrupted_save_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    path = tmp_path / "table.npz"
    table_of(kind, 1).save(path)
    before = path.read_bytes()

    def interrupted(file, **arrays):
        file.write(b"half a ta")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        table_of(kind, 2).save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["table.npz"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_holds_no_pickle(tmp_path: Path, kind: str) -> None:
    table_of(kind).save(tmp_path / "table.npz")
    with zipfile.ZipFile(tmp_path / "table.npz") as archive:
        for name in archive.namelist():
            assert b"'descr': '|O'" not in archive.read(name)
