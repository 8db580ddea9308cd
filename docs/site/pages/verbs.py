"""The page of verbs, from the parsers themselves."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from assetbuild.cli import VERBS, make_parser

INTRODUCTION = """\
# Verbs

`assetbuild VERB --help` prints the same in a terminal. Results go to standard output, progress and
log lines to standard error; `NO_COLOR` and `CI` are respected. [What checks what](checking.md)
compares the verbs that check something and lists all exit codes.
"""


def verb_page() -> str:
    """`docs/reference/verbs.md`."""
    parsers = _children(make_parser())
    return "\n".join([INTRODUCTION, *(_section(parsers[verb], "##") for verb in VERBS)])


def _children(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    groups = (
        a for a in parser._actions if isinstance(a, argparse._SubParsersAction)
    )  # argparse has no public way
    return next((dict(group.choices) for group in groups), {})


def _section(parser: argparse.ArgumentParser, level: str) -> str:
    lines = [f"{level} {parser.prog.removeprefix('assetbuild ')}", ""]
    lines += [_plain(parser.description or ""), "", "```text", _usage(parser), "```", ""]
    rows = list(_rows(parser))
    if rows:
        lines += ["| argument | meaning |", "| --- | --- |", *rows, ""]
    if parser.epilog:
        lines += [_plain(parser.epilog), ""]
    lines += [_section(child, level + "#") for child in _children(parser).values()]
    return "\n".join(lines)


def _usage(parser: argparse.ArgumentParser) -> str:
    """On one line, so that the width of a terminal does not decide the page."""
    return " ".join(parser.format_usage().removeprefix("usage: ").split())


def _rows(parser: argparse.ArgumentParser) -> Iterator[str]:
    for action in parser._actions:
        hidden = action.help == argparse.SUPPRESS
        if hidden or isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            continue
        value = "" if action.nargs == 0 else f" {action.metavar or _choices(action)}"
        names = ", ".join(action.option_strings)
        shown = f"`{names}{value}`" if names else f"`{action.metavar or action.dest}`"
        text = (action.help or "") % {**vars(action), "prog": parser.prog}
        yield f"| {_cell(shown)} | {_cell(_plain(text))} |"


def _choices(action: argparse.Action) -> str:
    return "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()


def _plain(text: str) -> str:
    """One line, in which Markdown takes `<robot>` for words."""
    return " ".join(text.split()).replace("<", "&lt;")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
