"""Every verb with its options, as one table, and the parser that is made of it."""

from __future__ import annotations

import argparse
import importlib
import os
from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from assetbuild._version import __version__
from assetbuild.cli.parser import (
    Parser,
    Recipes,
    file_or_robot,
    named_path,
    named_value,
    seconds,
    size_of_text,
    whole_number,
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


@dataclass(frozen=True)
class Option:
    """An argument as `add_argument` takes it. variable: of the environment, for its default."""

    names: tuple[str, ...]
    settings: Mapping[str, Any]  # Any: as argparse has it
    variable: str = ""

    def add(self, parser: Any) -> None:  # Any: a parser or a group of one
        """Declare it."""
        default = {"default": os.environ.get(self.variable, "")} if self.variable else {}
        parser.add_argument(*self.names, **self.settings, **default)


@dataclass(frozen=True)
class Verb:
    """What a verb takes. run: `module:function` of this package; default, `run` of its own.

    parts: verbs below it, `cache gc`.
    """

    help: str
    options: tuple[Option, ...] = ()
    run: str = ""
    epilog: str | None = None
    parts: Mapping[str, Verb] = field(default_factory=dict)

    def declare(self, parser: Parser) -> None:
        """Give a parser all that the verb takes."""
        for option in self.options:
            option.add(parser)
        if self.parts:
            below = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
            for name, part in self.parts.items():
                part.declare(below.add_parser(name, help=part.help))


def option(*names: str, variable: str = "", **settings: Any) -> Option:  # Any: as argparse has it
    """An argument of a verb."""
    return Option(names, settings, variable)


def switch(*names: str, help: str) -> Option:  # as argparse calls it
    """An option without a value."""
    return option(*names, action="store_true", help=help)


def out(what: str, metavar: str = "DIR") -> Option:
    """`-o`."""
    return option("-o", "--out", type=Path, metavar=metavar, help=what)


def verb(help: str, *options: Option, **more: Any) -> Verb:  # Any: of Verb
    """A verb with its options in the order of its help."""
    return Verb(help, options, **more)


RECIPE = option("recipe", type=file_or_robot, metavar="RECIPE")
RECIPES = option("recipes", nargs="+", type=file_or_robot, metavar="RECIPE", action=Recipes)
BUNDLE = option("bundle", type=Path, help="a folder that `assetbuild build` wrote")
POLICY = option("policy", type=Path, help="a folder with policy.onnx and its "
                "deploy.yaml or env.yaml, or one of these files")  # fmt: skip
VARIANT = option("--variant", metavar="NAME", help="a variant of the recipe")
JOBS = option("-j", "--jobs", type=whole_number(1), metavar="N", help="default: all cores")
PACKAGE = option(
    "--package", action="append", default=[], type=named_path, metavar="NAME=PATH",
    help="the folder that package://NAME stands for; others are looked for above the URDF",
)  # fmt: skip
REMOTE = option(
    "--remote", variable="ASSETBUILD_REMOTE", metavar="URL",
    help="cache shared with other machines, http(s)://... or s3://bucket/prefix; "
    "default: $ASSETBUILD_REMOTE",
)  # fmt: skip
SHARING = (REMOTE, switch("--cache-write", help="also write to that cache"))
"""What every verb that builds takes."""
BUILDING = (
    RECIPES,
    out("default: build/<robot>"),
    JOBS,
    switch("-k", "--keep-going", help="build all that does not depend on what failed"),
    VARIANT,
    switch("--frozen", help="fail rather than write a lock"),
    *SHARING,
    option("--executor", default="local", metavar="WHERE",
           help="local, or dask://HOST:PORT: run steps on the workers of that scheduler"),
    option("--sandbox", choices=("off", "strict"),
           help="no longer has an effect; the next version removes it"),
    option("--fail-on", choices=("error", "warning", "never"), default="error",
           help="default: error"),
)  # fmt: skip
"""What `build`, `smoke` and `watch` take."""
SHARED = (RECIPES, option("--variant", metavar="NAME", help="a variant of the recipes"), REMOTE)
"""What `cache push` and `cache pull` take."""

VERBS: Mapping[str, Verb] = {
    "bench": verb(
        "simulate the robot with collision geometry of every kind: quality against speed",
        RECIPE,
        out("default: build/<robot>-bench"),
        option("--levels", metavar="A,B", help="some of the levels; default: all"),
        option("--from", dest="source", choices=("auto", "collision", "visual"),
               default="auto", help="the meshes to work on; default: collision, else visual"),
        JOBS,
        VARIANT,
        *SHARING,
    ),
    "build": verb(
        "build the bundle; only stale steps run",
        *BUILDING,
        switch("-n", "--dry-run",
               help="print what would run; exit code 3 if anything would"),
        switch("--rehash", help="hash every source file again"),
        switch("--rebuild-check", help="run every step twice and compare"),
        option("--log-json", type=Path, metavar="FILE", help="write events, one per line"),
        option("--report-junit", type=Path, metavar="FILE", help="write JUnit XML"),
    ),
    "cache": verb(
        "look after the store: stats, check, gc, push, pull",
        epilog=WHICH_CHECK,
        parts={
            "stats": verb("count what the store holds", switch("--json", help="print data")),
            "check": verb("verify every object; corrupt ones are set aside"),
            "gc": verb(
                "remove what was used least recently",
                option("--max-size", required=True, type=size_of_text, metavar="SIZE",
                       help="as 5GB or 500MB"),
            ),
            "push": verb("send the results of recipes to a shared cache", *SHARED),
            "pull": verb("fetch the results of recipes from a shared cache", *SHARED),
        },
    ),
    "check": verb(
        "check recipes: schema, paths, static lints, lock up to date; runs nothing heavy",
        option("recipes", nargs="*", type=file_or_robot, metavar="RECIPE",
               help="default: recipes/*.yaml"),
        epilog=WHICH_CHECK,
    ),
    "completion": verb(
        "print a completion script for a shell",
        option("shell", choices=("bash", "zsh", "fish", "tcsh")),
        run="verbs:completion",
    ),
    "diff": verb(
        "compare two bundles, recipes, MJCF, URDF or USD files, Isaac Lab configurations",
        option("before", metavar="A", help=DIFFERENT),
        option("after", metavar="B", help="the same, to compare with A"),
        switch("--markdown", help="a table for a pull request"),
        switch("--exit-code", help="1 when anything differs"),
    ),
    "doctor": verb("report what this machine has and lacks, and how to get it", epilog=WHICH_CHECK),
    "explain": verb(
        "explain why steps ran or would run, by the part of the key that changed",
        RECIPE,
        option("step", nargs="?", metavar="STEP", help="or a file of the bundle; default: all"),
        VARIANT,
        switch("--json", help="print data"),
        run="plan:explain_steps",
    ),
    "identify": verb(
        "fit actuator numbers to logs of the real robot",
        RECIPE,
        switch("--write", help="write the identified values into the recipe"),
        switch("--ranges", help="print the intervals as `randomize.joints`"),
        switch("--excite", help="fit nothing: write commands to record on the robot"),
        option("--seconds", type=whole_number(10, 600), default=60, metavar="S",
               help="for --excite; default: 60"),
        out("for --excite; default: build/excite"),
        switch("--json", help="print all of it as JSON"),
        JOBS,
        VARIANT,
        *SHARING,
    ),
    "init": verb(
        "look at a robot and write a commented recipe that builds",
        option("robot", type=Path, nargs="?", metavar="ROBOT.urdf|.xacro|.xml"),
        option("--from", dest="origin", metavar="NAME",
               help="copy the recipe of a robot of the library"),
        out("default: <robot>.yaml, - prints it", "RECIPE"),
        PACKAGE,
        option("--arg", action="append", default=[], type=named_value, metavar="NAME=VALUE",
               help="an argument of a xacro file"),
        switch("--force", help="replace a recipe that exists"),
    ),
    "list": verb(
        "list the robots of the library, for `assetbuild build NAME`",
        run="verbs:library",
    ),
    "lock": verb("pin a recipe's source in <recipe>.lock.yaml", RECIPES, run="check:lock"),
    "plan": verb(
        "print the graph of a recipe: its steps by room",
        RECIPE,
        VARIANT,
        option("--format", choices=("text", "json", "dot"), default="text"),
    ),
    "policy": verb(
        "compare a policy with a bundle, or let it drive the robot",
        parts={
            "check": verb(
                "compare what a policy's files say with a bundle", POLICY, BUNDLE,
                switch("--json", help="findings as JSON"),
            ),
            "replay": verb(
                "let a policy drive the robot on a flat floor, and say why it falls",
                POLICY,
                BUNDLE,
                option("--engine", choices=("mujoco", "newton", "physx"), action="append",
                       help="may be repeated; default: mujoco"),
                option("--command", type=float, nargs=3, default=(0.5, 0.0, 0.0),
                       metavar=("X", "Y", "TURN"),
                       help="m/s forward, m/s to the left, rad/s; default: 0.5 0 0"),
                option("--seconds", type=seconds, default=10.0, metavar="S", help="default: 10"),
                option("--scene", default="scene.xml", metavar="FILE",
                       help="of the bundle's mjcf/; default: scene.xml"),
                option("--picture", type=Path, metavar="FILE",
                       help="write a PNG: the robot on its way, a row for each engine"),
                switch("--plain", help="do not look for a fault where it falls"),
                switch("--json", help="print data"),
            ),
        },
    ),
    "report": verb(
        "show the report of a bundle",
        BUNDLE,
        switch("--open", help="open the page in a browser"),
        option("--pictures", type=Path, metavar="DIR",
               help="draw into DIR: from behind, collision, inertia, joint axes, contacts"),
    ),
    "sample": verb(
        "draw robots from the recipe's `randomize` ranges and write them as MJCF",
        RECIPE,
        option("-n", "--count", type=whole_number(1, 1000), default=16, metavar="N",
               help="default: 16"),
        option("--judge", type=whole_number(1, 1_000_000), default=10_000, metavar="N",
               help="draws judged; default: 10000"),
        option("--seed", type=whole_number(0), metavar="N", help="default: the recipe's"),
        out("default: build/<robot>-samples"),
        JOBS,
        VARIANT,
        *SHARING,
    ),
    "schema": verb("print the JSON Schema of recipes, for editors", run="verbs:schema"),
    "smoke": verb(
        "build the bundle, then load, step and briefly train it in a trainer",
        *BUILDING,
        option("--consumer", choices=CONSUMERS, action="append", required=True,
               help="may be repeated"),
        switch("-y", "--yes", help="make environments without asking first"),
    ),
    "validate": verb(
        "check a bundle, or any MJCF, URDF or USD file",
        option("path", type=Path, metavar="FILE_OR_BUNDLE"),
        switch("--json", help="findings as JSON"),
        switch("--static", help="read the file, simulate nothing"),
        PACKAGE,
        *SHARING,
        epilog=WHICH_CHECK,
    ),
    "verify": verb(
        "compare a bundle with its manifest and its provenance", BUNDLE, epilog=WHICH_CHECK
    ),
    "watch": verb(
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
