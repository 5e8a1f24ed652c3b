"""Rules of the code base that a reader can rely on, checked on the syntax trees."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import pflut

PACKAGE = Path(pflut.__file__).parent

# From the bottom to the top. A name stands for a module, or for all of a package that is not named
# more closely. A module may import what stands on a line before its own, and what has its own name;
# names on one line do not import each other.
ORDER = [
    "_jit _lanes _files _cache _lazy _extras geometry",
    "_trig _random _robust _cells _jobs correspondences trajectory statistics",
    "camera evaluation reliability von_mises alignment",
    "features",
    "simulation",
    "datasets",
    "likelihood",
    "posterior",
    "relpose",
    "retrieval pair_errors",
    "reference_map",
    "localization",
    "pairs plot",
    "calibration comparison mapping",
    "environment",
    "replay",
    "campaign",
    "results",
    "cli",
]
RANK = {name: rank for rank, line in enumerate(ORDER) for name in line.split()}

# What their editors delete Numba's cache for.
SHARED_KERNELS = {"_trig", "_lanes", "_random", "_robust", "_cells", "von_mises._components"}

MODULES = sorted(PACKAGE.rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in MODULES}


def dotted(path: Path) -> str:
    """`camera.base` for pflut/camera/base.py, `camera` for its package, `` for pflut itself."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def imports(tree: ast.AST) -> Iterator[tuple[str, list[str], int]]:
    """Every import anywhere in a file, those in functions and for types too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, [], node.lineno
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield str(node.module), [alias.name for alias in node.names], node.lineno


def unit(module: str) -> str:
    """The name in ORDER that a dotted module below pflut belongs to."""
    names = [name for name in RANK if f"{module}.".startswith(f"{name}.")]
    return max(names, key=len, default=module)


def every_module(check: Callable[[Path], None]) -> Callable[[], None]:
    """Make one test of a check of one module; it tells of all modules that fail."""

    def test() -> None:
        failures = []
        for path in MODULES:
            try:
                check(path)
            except AssertionError as error:
                failures.append(f"{dotted(path) or 'pflut'}: {error}")
        assert not failures, "\n".join(failures)

    test.__doc__ = check.__doc__
    return test


def test_every_module_has_its_place() -> None:
    units = {unit(dotted(path)) for path in MODULES if dotted(path)}
    assert units == set(RANK)


@every_module
def test_imports_point_down(path: Path) -> None:
    here = unit(dotted(path))
    upward = []
    for module, names, line in imports(TREES[path]):
        if module.split(".")[0] != "pflut":
            continue
        targets = [module.removeprefix("pflut").lstrip(".")]
        if targets == [""]:
            # `from pflut import x` is a module or a public name; `import pflut` is for its version
            targets = [name for name in names if unit(name) in RANK]
            foreign = set(names) - set(targets) - {"__version__"}
            assert not foreign, f"line {line}: public names are for users: {sorted(foreign)}"
        for target in map(unit, targets):
            # pflut itself stands above all that it hands on
            if target != here and RANK[target] >= RANK.get(here, len(ORDER)):
                upward.append(f"line {line}: {here or 'pflut'} imports {target}")
    assert not upward


@every_module
def test_pflut_itself_is_imported_for_its_version_or_place_only(path: Path) -> None:
    used = {
        node.attr
        for node in ast.walk(TREES[path])
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "pflut"
    }
    # `pflut info` says where the compiled kernels are kept
    assert used <= {"__version__", "__file__"} | ({"_jit"} if dotted(path) == "cli.info" else set())


def is_kernel(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and any(
        isinstance(decorator, ast.Name) and decorator.id in {"jit", "inline"}
        for decorator in node.decorator_list
    )


@every_module
def test_kernels_call_kernels_of_their_own_file(path: Path) -> None:
    """Numba's cache does not notice a change in a callee of another file (numba#1833).

    Five files are exceptions, and say so to whoever edits them.
    """
    tree = TREES[path]
    foreign = {
        name: module
        for module, names, _ in imports(tree)
        for name in names
        if module.startswith("pflut") and module.removeprefix("pflut.") not in SHARED_KERNELS
    }
    for kernel in filter(is_kernel, ast.walk(tree)):
        for node in ast.walk(kernel):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in foreign, f"{kernel.name} calls {node.func.id}"
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                assert node.value.id in {"np", "math"} or node.value.id not in foreign


@every_module
def test_numba_is_used_through_the_one_decorator(path: Path) -> None:
    if dotted(path) in {"_jit", "_lanes"}:
        return
    heads = {module.split(".")[0] for module, _, _ in imports(TREES[path])}
    assert "numba" not in heads or dotted(path).startswith(("cli", "environment"))


@every_module
def test_kernels_hold_no_hidden_state(path: Path) -> None:
    """No random numbers of NumPy's global state, no allocation of their results."""
    for kernel in filter(is_kernel, ast.walk(TREES[path])):
        text = ast.unparse(kernel)
        assert "np.random" not in text, kernel.name


@every_module
def test_the_library_is_silent(path: Path) -> None:
    if dotted(path).split(".")[0] == "cli":
        return
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"print", "input", "breakpoint", "exit"}, node.lineno
    for module, _, line in imports(TREES[path]):
        assert module.split(".")[0] not in {"tqdm", "logging", "argparse"}, line
    assert "sys.exit" not in ast.unparse(TREES[path])


@every_module
def test_no_pickle_is_ever_loaded(path: Path) -> None:
    for module, _, line in imports(TREES[path]):
        forbidden = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve", "cloudpickle"}
        assert module.split(".")[0] not in forbidden, line
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in {"np.load", "numpy.load"}:
            options = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
            assert options.get("allow_pickle") == "False", node.lineno
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"eval", "exec"}, node.lineno


@every_module
def test_no_global_random_state(path: Path) -> None:
    allowed = {"default_rng", "Generator", "SeedSequence", "PCG64"}
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in {"np.random", "random"}:
            assert node.attr in allowed, f"line {node.lineno}: {ast.unparse(node)}"


def public_functions(
    body: list[ast.stmt], prefix: str = ""
) -> Iterator[tuple[str, ast.FunctionDef, bool]]:
    """Public functions and methods with their names, and whether one is a method."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body, f"{node.name}.")
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            stub = ast.unparse(node.body[-1]) == "..." and len(node.body) == 1  # of a protocol
            if not node.name.startswith("_") and not stub:
                yield prefix + node.name, node, bool(prefix)


@every_module
def test_public_functions_are_documented_and_annotated(path: Path) -> None:
    assert ast.get_docstring(TREES[path]) or not TREES[path].body
    for name, node, is_method in public_functions(TREES[path].body):
        assert ast.get_docstring(node), f"{name} has no docstring"
        if is_kernel(node):
            continue
        assert node.returns is not None, f"{name} does not say what it returns"
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        skip = is_method and "staticmethod" not in map(ast.unparse, node.decorator_list)
        for argument in arguments[1:] if skip else arguments:
            assert argument.annotation is not None, f"{name}: {argument.arg}"


@every_module
def test_public_classes_are_documented(path: Path) -> None:
    for node in TREES[path].body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), node.name


@every_module
def test_identifiers_are_ascii(path: Path) -> None:
    for node in ast.walk(TREES[path]):
        for name in (getattr(node, "id", ""), getattr(node, "arg", ""), getattr(node, "name", "")):
            assert not isinstance(name, str) or name.isascii(), name


def modules_after(statement: str) -> set[str]:
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    return set(done.stdout.split())


def test_import_is_light() -> None:
    loaded = modules_after("import pflut")
    assert "pflut" in loaded
    heavy = {"numpy", "numba", "cv2", "matplotlib", "filterpy", "scipy", "tqdm", "PIL"}
    assert not loaded & heavy


def test_public_names_bring_what_they_need_only() -> None:
    loaded = modules_after("import pflut\npflut.Correspondences, pflut.Trajectory, pflut.Dataset")
    assert "pflut.correspondences" in loaded
    assert not loaded & {"numba", "matplotlib", "filterpy", "tqdm"}
    # the whole way from a table to an estimate needs no image and no figure
    loaded = modules_after("import pflut\npflut.LikelihoodTable, pflut.estimate_relative_pose")
    assert not loaded & {"cv2", "matplotlib", "filterpy", "tqdm"}


def test_public_names_exist_and_are_listed() -> None:
    assert sorted(pflut.__all__) == pflut.__all__
    for name in pflut.__all__:
        assert getattr(pflut, name) is not None
    assert dir(pflut) == pflut.__all__
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = pflut.nothing


PACKAGES = [path for path in MODULES if path.name == "__init__.py" and "lazy(" in path.read_text()]


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_lazy_names_are_those_that_type_checkers_see(path: Path) -> None:
    """A name that is found at run time has a type, and the other way round, in one module."""
    tree = TREES[path]
    checked = {
        alias.asname: node.module
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assigned = next(
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "_NAMES"
    )
    package = ".".join(["pflut", *path.relative_to(PACKAGE).parent.parts])
    found = {name: f"{package}.{module}" for name, module in ast.literal_eval(assigned).items()}
    assert checked == found
