"""Write the options of every verb into docs/cli.md, from the command line's own parser.

    python sims/doc_options.py

Each table stands between ``<!-- options: VERB -->`` and ``<!-- end -->``; a test checks that the
page is up to date.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from pflut.cli import make_parser

PAGE = Path(__file__).parents[1] / "docs" / "cli.md"
MARKED = re.compile(r"(<!-- options: (.+?) -->\n).*?(<!-- end -->)", re.DOTALL)


def parsers(
    parser: argparse.ArgumentParser, name: str = ""
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Give all verbs, and the actions of verbs that have some, by their full names."""
    choices = [a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not choices:
        yield name, parser
    for verbs in choices:
        for verb, below in verbs.items():
            yield from parsers(below, f"{name} {verb}".strip())


def table(parser: argparse.ArgumentParser) -> str:
    """Give a verb's arguments and options, group by group, as Markdown."""
    lines = []
    for group in parser._action_groups:
        actions = [a for a in group._group_actions if not isinstance(a, argparse._HelpAction)]
        if actions:
            lines += ["", f"| {group.title} | |", "| --- | --- |"]
            lines += [f"| {spelled(action)} | {meaning(action)} |" for action in actions]
    return "\n".join(lines) + "\n\n"


def spelled(action: argparse.Action) -> str:
    """Give an option as it is typed."""
    value = ""
    if action.choices is not None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    elif action.nargs != 0 and action.metavar is not None:
        value = str(action.metavar)
    names = ", ".join(f"{name} {value}".strip() for name in action.option_strings) or value
    return "`" + names.replace("|", "\\|") + "`"


def meaning(action: argparse.Action) -> str:
    """Give an option's help text."""
    return (
        (action.help or "")
        .replace("%(default)s", str(action.default))
        .replace("%%", "%")
        .replace("<", "&lt;")
    )


def filled(page: str) -> str:
    """Give the page with the tables as they should be."""
    verbs = dict(parsers(make_parser()))
    return MARKED.sub(lambda found: found[1] + table(verbs[found[2]]) + found[3], page)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
