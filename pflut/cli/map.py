"""``pflut map``: from a drive to a map; one action, one file."""

from __future__ import annotations

from pflut.cli import map_build, map_links, map_localize, map_places
from pflut.cli.arguments import Subparsers, add_verb


def add_parser(verbs: Subparsers) -> None:
    """Add the verb and its actions."""
    parser = add_verb(
        verbs,
        "map",
        "link the images of a drive (links), make a map of it (build), find its places (places),\n"
        "or a robot in these (localize)",
        usage="{links,build,places,localize} ...",
    )
    actions = parser.add_subparsers(
        title="actions", metavar="ACTION", required=True, prog=parser.prog
    )
    for action in (map_links, map_build, map_places, map_localize):
        action.add_parser(actions)
