"""The documentation names what exists: links, commands, options, functions, files."""

from __future__ import annotations

import argparse
import importlib.util
import re
import shlex
import tomllib
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import pflut
from pflut.cli import make_parser

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "sims" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
CODE = re.compile(r"`([^`\n]+)`")
MAX_IMAGE_BYTES = 400_000


def load_script(name: str) -> ModuleType:
    """Import a script of sims/."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "sims" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def anchors(markdown: str) -> set[str]:
    """Give the anchors of a page's headings, as Python-Markdown and GitHub name them."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", markdown), re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", heading.strip().lower()) for heading in headings]
    return {heading.replace(" ", "-") for heading in plain}


def commands(name: str) -> list[str]:
    """Give the commands of a page: the console blocks', and those in running text."""
    text = text_of(name)
    blocks = [body for kind, body in FENCE.findall(text) if kind == "console"]
    typed = re.findall(r"^\$ (.*)$", "".join(blocks), re.MULTILINE)
    inline = [code for code in CODE.findall(FENCE.sub("", text)) if " " in code]
    return typed + [code for code in inline if re.match(r"(pflut|python sims/\S+) \S", code)]


@cache
def options() -> dict[str, set[str]]:
    """Give the options of every verb, by its full name."""
    script = load_script("doc_options")
    return {
        verb: {option for action in parser._actions for option in action.option_strings}
        for verb, parser in script.parsers(make_parser())
    }


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", text_of(name))):
        if re.match(r"https?://|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        linked = page if not path else (page.parent / path).resolve()
        assert linked.exists(), f"{name}: {target}"
        if anchor:
            assert anchor in anchors(linked.read_text(encoding="utf-8")), f"{name}: {target}"


@pytest.mark.parametrize("name", NAMES)
def test_commands_exist(name: str) -> None:
    for command in commands(name):
        words = shlex.split(command.replace("DATASET", "x"))
        if words[0] == "python":
            if len(words) > 1 and words[1].startswith("sims/"):
                script = text_of(words[1])
                for word in words[2:]:
                    assert not word.startswith("--") or f'"{word}"' in script, command
            continue
        if words[0] != "pflut" or words[1] in ("VERB", "--help", "--version"):
            continue
        verb = " ".join(words[1:3]) if words[1] in ("lut", "dataset", "map") else words[1]
        if verb in ("lut", "dataset", "map"):  # the verb alone, in running text
            continue
        assert verb in options(), f"{name}: {command}"
        for word in words:
            if word.startswith("--"):
                assert word.partition("=")[0] in options()[verb], f"{name}: {command}"


@pytest.mark.parametrize("name", NAMES)
def test_console_blocks_parse(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    for kind, body in FENCE.findall(text_of(name)):
        if kind != "console":
            continue
        for command in re.findall(r"^\$ pflut (.*)$", body, re.MULTILINE):
            parsed = make_parser().parse_args(shlex.split(command))
            assert isinstance(parsed, argparse.Namespace)


@pytest.mark.parametrize("name", NAMES)
def test_options_in_running_text_exist(name: str) -> None:
    known = {option for some in options().values() for option in some}
    scripts = "".join(path.read_text() for path in (ROOT / "sims").glob("*.py"))
    for code in CODE.findall(FENCE.sub("", text_of(name))):
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", code):
            assert option in known or f'"{option}"' in scripts, f"{name}: {code}"


@pytest.mark.parametrize("name", NAMES)
def test_names_and_files_exist(name: str) -> None:
    text = FENCE.sub("", text_of(name))
    named = re.findall(r"^::: (\S+)$", text, re.MULTILINE)
    named += re.findall(r"`(pflut(?:\.\w+)+)", text)
    for dotted in named:
        resolve(dotted)
    for path in re.findall(r"`((?:pflut|sims|docs|tests)/[\w/.]+)`", text):
        assert (ROOT / path).exists(), f"{name}: {path}"
    for before, path in re.findall(r"((?:`\w+`(?:, | and )?)+) in `(pflut/[\w/]+\.py)`", text):
        source = text_of(path)
        for function in CODE.findall(before):
            assert f"def {function}(" in source, f"{name}: {function} in {path}"


def resolve(dotted: str) -> object:
    """Import a module, or a name of one, or an attribute or field of a class."""
    parts = dotted.split(".")
    found: object = import_module(parts[0])
    for i, part in enumerate(parts[1:], start=2):
        try:
            found = getattr(found, part)
        except AttributeError:
            if part in getattr(found, "__annotations__", {}):
                return found
            found = import_module(".".join(parts[:i]))
    return found


def test_options_of_the_command_line_page_are_up_to_date() -> None:
    page = text_of("docs/cli.md")
    script = load_script("doc_options")
    assert script.filled(page) == page, "run: python sims/doc_options.py"
    assert set(re.findall(r"<!-- options: (.+?) -->", page)) >= set(options()) - {"info"}


def test_every_public_name_is_in_the_api_page() -> None:
    page = text_of("docs/api.md")
    documented = {dotted.rpartition(".")[2] for dotted in re.findall(r"^::: (\S+)$", page, re.M)}
    assert set(pflut.__all__) - {"__version__"} <= documented


def test_every_page_is_in_the_navigation() -> None:
    navigation = re.findall(r"^ +- .*: (\S+\.md)$", text_of("mkdocs.yml"), re.MULTILINE)
    assert sorted(navigation) == sorted(path.name for path in (ROOT / "docs").glob("*.md"))


def test_every_script_is_in_its_table() -> None:
    table = text_of("sims/README.md")
    for script in (ROOT / "sims").glob("*.py"):
        assert f"python sims/{script.name}" in table, script.name


def test_images_are_small_and_shown() -> None:
    pages = "".join(map(text_of, NAMES))
    for image in (ROOT / "docs" / "images").iterdir():
        assert image.stat().st_size < MAX_IMAGE_BYTES, image.name
        assert f"images/{image.name}" in pages, image.name


def test_versions_agree() -> None:
    assert f"\nversion: {pflut.__version__}\n" in text_of("CITATION.cff")
    assert pflut.__version__ in text_of("CHANGELOG.md")
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    assert f"\nlicense: {project['license']}\n" in text_of("CITATION.cff")
