"""Every verb with its options, as one table, and the parser that is made of it."""

from __future__ import annotations

import argparse
import importlib
import os
from argparse import Namespace
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from assetbuild._version import __version__
from assetbuild.cli.parser import (
    Parser,
    file_or_robot,
    named_path,
    named_value,
    number,
    size_of_text,
)

WHICH_CHECK = (
    "`check` reads recipes, `validate` proves built files, `verify` compares digests, `doctor` "
    "looks at this machine, `cache check` at the store: see docs/reference/checking.md"
)
"""The last line of the help of these five verbs."""
CONSUMERS = ("mjlab", "newton", "isaaclab", "simready", "asset_validator")
DIFFERENT = (
    "bundle, recipe, REVISION:RECIPE of git, MJCF, URDF, USD, Isaac Lab's FILE.py[:CFG], or "
    "readings of Isaac Lab (JSON)"
)


class Option:
    """An argument as `add_argument` takes it. variable: of the environment, for its default."""

    def __init__(self, *names: str, variable: str = "", **settings: Any) -> None:  # Any: argparse's
        self.names, self.variable, self.settings = names, variable, settings

    def add(self, parser: Any) -> None:  # Any: a parser or a group of one
        """Declare it."""
        default = {"default": os.environ.get(self.variable, "")} if self.variable else {}
        parser.add_argument(*self.names, **self.settings, **default)


class Verb:
    """What a verb takes, its options in the order of its help.

    run: `module:function` of this package; default, `run` of its own. parts: verbs below it,
    `cache gc`.
    """

    def __init__(
        self,
        help: str,
        *options: Option,
        run: str = "",
        epilog: str | None = None,
        parts: Mapping[str, Verb] | None = None,
    ) -> None:
        self.help, self.options, self.run, self.epilog = help, options, run, epilog
        self.parts = parts or {}

    def declare(self, parser: Parser) -> None:
        """Give a parser all that the verb takes."""
        for option in self.options:
            option.add(parser)
        if self.parts:
            below = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
            for name, part in self.parts.items():
                part.declare(below.add_parser(name, help=part.help))


def switch(*names: str, help: str) -> Option:  # as argparse calls it
    """An option without a value."""
    return Option(*names, action="store_true", help=help)


def out(what: str, metavar: str = "DIR") -> Option:
    """`-o`."""
    return Option("-o", "--out", type=Path, metavar=metavar, help=what)


FILE_OR_ROBOT = "a file, or the name of a robot of the library (`assetbuild list`)"
RECIPE = Option("recipe", type=file_or_robot, metavar="RECIPE", help=FILE_OR_ROBOT)
RECIPES = Option("recipes", nargs="+", type=file_or_robot, metavar="RECIPE", help=FILE_OR_ROBOT)
BUNDLE = Option("bundle", type=Path, metavar="BUNDLE", help="a folder that `build` wrote")
POLICY = Option("policy", type=Path, help="a folder with policy.onnx and its "
                "deploy.yaml or env.yaml, or one of these files")  # fmt: skip
VARIANT = Option("--variant", metavar="NAME", help="a variant of the recipe")
JOBS = Option("-j", "--jobs", type=number(1), metavar="N", help="default: all cores")
PACKAGE = Option(
    "--package", action="append", default=[], type=named_path, metavar="NAME=PATH",
    help="the folder that package://NAME stands for; others are looked for above the URDF",
)  # fmt: skip
REMOTE = Option(
    "--remote", variable="ASSETBUILD_REMOTE", metavar="URL",
    help="cache shared with other machines, http(s)://... or s3://bucket/prefix; "
    "default: $ASSETBUILD_REMOTE",
)  # fmt: skip
SHARING = (REMOTE, switch("--cache-write", help="also write to that cache"))
"""What every verb that builds takes."""
STEPS = (JOBS, VARIANT, *SHARING)
"""What verbs take that build something of their own."""
BUILDING = (
    RECIPES,
    out("default: build/<robot>"),
    JOBS,
    switch("-k", "--keep-going", help="build all that does not depend on what failed"),
    VARIANT,
    switch("--frozen", help="exit with 3 rather than write a lock"),
    *SHARING,
    Option("--executor", default="local", metavar="WHERE",
           help="local, or dask://HOST:PORT: run steps on the workers of that scheduler"),
    Option("--sandbox", choices=("off", "strict"),
           help="no longer has an effect; the next version removes it"),
    Option("--fail-on", choices=("error", "warning", "never"), default="error",
           help="the least severity that makes the exit code 1; default: error"),
)  # fmt: skip
"""What `build`, `smoke` and `watch` take."""
SHARED = (RECIPES, Option("--variant", metavar="NAME", help="a variant of the recipes"), REMOTE)
"""What `cache push` and `cache pull` take."""

VERBS: Mapping[str, Verb] = {
    "bench": Verb(
        "simulate the robot with collision geometry of every kind: quality against speed",
        RECIPE,
        out("default: build/<robot>-bench"),
        Option("--levels", metavar="A,B", help="such as `hull,primitives`; default: all"),
        Option("--from", dest="source", choices=("auto", "collision", "visual"),
               default="auto", help="the meshes to work on; default: collision, else visual"),
        *STEPS,
    ),
    "build": Verb(
        "build the bundle; only stale steps run",
        *BUILDING,
        switch("-n", "--dry-run",
               help="print what would run; exit code 3 if anything would"),
        switch("--rehash", help="hash every source file again"),
        switch("--rebuild-check", help="run every step twice and compare"),
        Option("--log-json", type=Path, metavar="FILE", help="write events, one per line"),
        Option("--report-junit", type=Path, metavar="FILE", help="write JUnit XML"),
    ),
    "cache": Verb(
        "look after the store: stats, check, gc, push, pull",
        epilog=WHICH_CHECK,
        parts={
            "stats": Verb("count what the store holds", switch("--json", help="print data")),
            "check": Verb("verify every object; corrupt ones are set aside"),
            "gc": Verb(
                "remove what was used least recently",
                Option("--max-size", required=True, type=size_of_text, metavar="SIZE",
                       help="as 5GB or 500MB"),
            ),
            "push": Verb("send the results of recipes to a shared cache", *SHARED),
            "pull": Verb("fetch the results of recipes from a shared cache", *SHARED),
        },
    ),
    "check": Verb(
        "check recipes: schema, paths, static lints, lock up to date; runs nothing heavy",
        Option("recipes", nargs="*", type=file_or_robot, metavar="RECIPE",
               help="default: recipes/*.yaml"),
        epilog=WHICH_CHECK,
    ),
    "completion": Verb(
        "print a completion script for a shell",
        Option("shell", choices=("bash", "zsh", "fish", "tcsh")),
        run="verbs:completion",
    ),
    "diff": Verb(
        "compare two bundles, recipes, MJCF, URDF or USD files, Isaac Lab configurations",
        Option("before", metavar="A", help=DIFFERENT),
        Option("after", metavar="B", help="the same, to compare with A"),
        switch("--markdown", help="a table for a pull request"),
        switch("--exit-code", help="1 when anything differs"),
    ),
    "doctor": Verb("report what this machine has and lacks, and how to get it", epilog=WHICH_CHECK),
    "explain": Verb(
        "explain why steps ran or would run, by the part of the key that changed",
        RECIPE,
        Option("step", nargs="?", metavar="STEP", help="or a path in a bundle; default: all"),
        VARIANT,
        switch("--json", help="print data"),
        run="plan:explain_steps",
    ),
    "identify": Verb(
        "fit actuator numbers to logs of the real robot",
        RECIPE,
        switch("--write", help="write the identified values into the recipe"),
        switch("--ranges", help="print the intervals as `randomize.joints`"),
        switch("--excite", help="fit nothing: write commands to record on the robot"),
        Option("--seconds", type=number(10, 600), default=60, metavar="S",
               help="for --excite; default: 60"),
        out("for --excite; default: build/excite"),
        switch("--json", help="print all of it as JSON"),
        *STEPS,
    ),
    "init": Verb(
        "look at a robot and write a commented recipe that builds",
        Option("robot", type=Path, nargs="?", metavar="ROBOT.urdf|.xacro|.xml"),
        Option("--from", dest="origin", metavar="NAME",
               help="copy the recipe of a robot of the library"),
        out("default: <robot>.yaml, - prints it", "RECIPE"),
        PACKAGE,
        Option("--arg", action="append", default=[], type=named_value, metavar="NAME=VALUE",
               help="an argument of a xacro file"),
        switch("--force", help="replace a recipe that exists"),
    ),
    "list": Verb(
        "list the robots of the library, for `assetbuild build NAME`",
        run="verbs:library",
    ),
    "lock": Verb("pin a recipe's source in <recipe>.lock.yaml", RECIPES, run="check:lock"),
    "plan": Verb(
        "print the graph of a recipe: its steps by room",
        RECIPE,
        VARIANT,
        Option("--format", choices=("text", "json", "dot"), default="text"),
    ),
    "policy": Verb(
        "compare a policy with a bundle, or let it drive the robot",
        parts={
            "check": Verb(
                "compare what a policy's files say with a bundle", POLICY, BUNDLE,
                switch("--json", help="findings as JSON"),
            ),
            "replay": Verb(
                "let a policy drive the robot on a flat floor, and say why it falls",
                POLICY,
                BUNDLE,
                Option("--engine", choices=("mujoco", "newton", "physx"), action="append",
                       help="may be repeated; default: mujoco"),
                Option("--command", type=float, nargs=3, default=(0.5, 0.0, 0.0),
                       metavar=("X", "Y", "TURN"),
                       help="m/s forward, m/s to the left, rad/s; default: 0.5 0 0"),
                Option("--seconds", type=number(0.1, 3600.0, "seconds"), default=10.0,
                       metavar="S", help="default: 10"),
                Option("--scene", default="scene.xml", metavar="FILE",
                       help="of the bundle's mjcf/; default: scene.xml"),
                Option("--picture", type=Path, metavar="FILE",
                       help="write a PNG: the robot on its way, a row for each engine"),
                switch("--plain", help="do not look for a fault where it falls"),
                switch("--json", help="print data"),
            ),
        },
    ),
    "report": Verb(
        "show the report of a bundle",
        BUNDLE,
        switch("--open", help="open the page in a browser"),
        Option("--pictures", type=Path, metavar="DIR",
               help="draw into DIR: from behind, collision, inertia, joint axes, contacts"),
    ),
    "sample": Verb(
        "draw robots from the recipe's `randomize` ranges and write them as MJCF",
        RECIPE,
        Option("-n", "--count", type=number(1, 1000), default=16, metavar="N",
               help="default: 16"),
        Option("--judge", type=number(1, 1_000_000), default=10_000, metavar="N",
               help="draws in the printed statistics; default: 10000"),
        Option("--seed", type=number(0), metavar="N", help="default: the recipe's"),
        out("default: build/<robot>-samples"),
        *STEPS,
    ),
    "schema": Verb("print the JSON Schema of recipes, for editors", run="verbs:schema"),
    "smoke": Verb(
        "build the bundle, then load, step and briefly train it in a trainer",
        *BUILDING,
        Option("--consumer", choices=CONSUMERS, action="append", required=True,
               help="may be repeated"),
        switch("-y", "--yes", help="make environments without asking first"),
    ),
    "validate": Verb(
        "check a bundle, or any MJCF, URDF or USD file",
        Option("path", type=Path, metavar="FILE_OR_BUNDLE"),
        switch("--json", help="findings as JSON"),
        switch("--static", help="read the file, simulate nothing"),
        PACKAGE,
        *SHARING,
        epilog=WHICH_CHECK,
    ),
    "verify": Verb(
        "compare a bundle with its manifest and its provenance", BUNDLE, epilog=WHICH_CHECK
    ),
    "watch": Verb(
        "build, and again whenever the recipe or a source changes; Ctrl-C ends it", *BUILDING
    ),
}  # fmt: skip
"""In the order of the help."""


def make_parser() -> Parser:
    """Return the parser of all verbs."""
    parser = Parser(
        prog="assetbuild",
        description="A declarative build system for robot assets",
        epilog="exit codes: 0 ok, 1 a step or check failed, 2 wrong input, 3 out of date, "
        "4 not reproducible, 130 interrupted",
    )
    parser.add_argument("--version", action="version", version=f"assetbuild {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    for name, verb in VERBS.items():
        verb.declare(
            verbs.add_parser(name, help=verb.help, description=verb.help, epilog=verb.epilog)
        )
    return parser


def runner(verb: str) -> Callable[[Namespace], int]:
    """The function of a verb; its module is imported now."""
    module, _, function = (VERBS[verb].run or f"{verb}:run").partition(":")
    run: Callable[[Namespace], int] = getattr(
        importlib.import_module(f"assetbuild.cli.{module}"), function
    )
    return run


def completion(arguments: argparse.Namespace) -> int:
    """Print a script for the shell; nothing of it runs when a verb starts."""
    import shtab

    print(shtab.complete(make_parser(), arguments.shell))
    return 0


def schema(_: argparse.Namespace) -> int:
    """Print the JSON Schema of recipes."""
    from assetbuild.pipeline.recipes import schema_text

    print(schema_text(), end="")
    return 0


def library(_: argparse.Namespace) -> int:
    """A line for each robot."""
    from assetbuild.library import robots, sentence

    recipes = robots()
    width = max(map(len, recipes))
    for name, path in recipes.items():
        print(f"{name:{width}}  {sentence(path)}")
    return 0
