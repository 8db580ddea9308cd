"""A recipe file to a `Recipe` that still knows its lines. Recipes may be hostile."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from assetbuild.engine.world import World
from assetbuild.errors import AssetBuildError, Gather, RecipeError, Where, did_you_mean
from assetbuild.findings import Finding
from assetbuild.lfs import refuse_pointer
from assetbuild.recipe.models import Part, Recipe
from assetbuild.recipe.renamed_keys import with_new_keys
from assetbuild.recipe.validation import Key, KeyedError, follow, key_text, locate, validated
from assetbuild.recipe.yaml_tree import MAX_BYTES, MAX_COST, Entry, Node, described, parse
from assetbuild.robot.actuator_table import RowError

FIRST_MATCH_WINS: frozenset[tuple[str, ...]] = frozenset(
    {("collision", "links"), ("contact", "links"), ("randomize", "links"), ("randomize", "joints")}
)
"""Maps whose order decides: there the patch's new keys come first, so that the variant wins."""
_NOT_IN_A_VARIANT = ("schema", "variants")


def variant_names(root: Node) -> tuple[str, ...]:
    """Names of the variants in a recipe's tree, in file order."""
    variants = _entries(root).get("variants")
    return tuple(_entries(variants.node)) if variants else ()


def patched(root: Node, variant: str) -> Node:
    """The recipe's tree with one variant applied; RecipeError when there is none of that name.

    Maps are merged, everything else is replaced. The tree is patched and not the data, so that
    each value keeps the line that it came from.
    """
    names = variant_names(root)
    if variant not in names:
        variants = _entries(root).get("variants")
        hint = did_you_mean(variant, names) or "the recipe has no `variants`"
        where = variants.where if variants else root.where
        raise RecipeError(f"no variant named `{variant}`", where=where, hint=hint)
    entry = _entries(_entries(root)["variants"].node)[variant]
    if not isinstance(entry.node.value, dict):
        raise RecipeError(f"variants.{variant}: expected a map", where=entry.where)
    for name in _NOT_IN_A_VARIANT:
        if name in entry.node.value:
            raise RecipeError(
                f"variants.{variant}.{name}: a variant cannot change `{name}`",
                where=entry.node.value[name].where,
            )
    return _merged(root, entry.node, ())


def _merged(base: Node, patch: Node, path: tuple[str, ...]) -> Node:
    if not isinstance(base.value, dict) or not isinstance(patch.value, dict):
        return patch
    old, new = base.value, patch.value
    changed = {
        key: Entry(
            entry.where,
            _merged(old[key].node, entry.node, (*path, key)) if key in old else entry.node,
        )
        for key, entry in new.items()
    }
    if path in FIRST_MATCH_WINS:
        value = changed | {key: entry for key, entry in old.items() if key not in changed}
    else:
        value = {key: changed.get(key, entry) for key, entry in old.items()} | changed
    # Shown where the base has it: an error about the map as a whole is rarely the patch's fault.
    return Node(base.where, value)


def _entries(node: Node) -> Mapping[str, Entry]:
    return node.value if isinstance(node.value, dict) else {}


@dataclass(frozen=True)
class LoadedRecipe:
    """A valid recipe, the place of each of its keys, and the world it was read from.

    path: absolute. file: the name for people, relative to the working folder when below it.
    variant: the one that was applied, or None. world: what was asked to read it. renamed: what is
    said of keys that are stated by an old name.
    parts: the recipes that `compose` names, in its order; those of a `source` are made of this one
    and `inline`.
    """

    recipe: Recipe
    path: Path
    file: str
    variant: str | None
    tree: Node = field(repr=False)
    world: World = field(repr=False, compare=False)
    renamed: tuple[Finding, ...] = ()
    parts: tuple[LoadedRecipe, ...] = ()
    inline: bool = False

    def origin(self, key: Key) -> tuple[LoadedRecipe, Key]:
        """The recipe that a key is written in, and the key there; of a composite maybe a part's."""
        return self, key

    @property
    def folder(self) -> Path:
        """Where its paths begin."""
        return self.path.parent

    def where(self, key: Key) -> Where:
        """The place of a key such as `("actuators", 2, "kp")`; of the nearest above if absent."""
        recipe, part_key = self.origin(key)
        return locate(recipe.tree, part_key)

    @property
    def by_prefix(self) -> Mapping[str, LoadedRecipe]:
        """The recipes of the parts, by the prefix of their names."""
        rows = self.recipe.compose
        return {row.as_: part for row, part in zip(rows, self.parts, strict=True)}

    def but(self, **sections: object) -> LoadedRecipe:
        """A copy of the recipe with other values of these sections."""
        return replace(self, recipe=self.recipe.model_copy(update=sections))

    def error(self, key: Key, message: str, hint: str = "") -> RecipeError:
        """An error about a key: its place, its path, what is wrong, the next move."""
        _, part_key = self.origin(key)
        return RecipeError(f"{key_text(part_key)}: {message}", where=self.where(key), hint=hint)

    @contextmanager
    def placing(self) -> Iterator[None]:
        """Errors about keys, raised by what knows no lines, get their places."""
        try:
            yield
        except RowError as error:
            wrong = Gather(RecipeError)
            for each in error.each():
                with wrong:
                    raise self._placed(each) from None
            wrong.stop(error.uncounted)

    def _placed(self, error: AssetBuildError) -> AssetBuildError:
        """The row of a part has another index in the part's recipe."""
        if not isinstance(error, RowError):
            return error
        if isinstance(error, KeyedError):
            return self.error(error.key, error.reason, error.hint)
        _, part_key = self.origin(error.key)
        message = error.message.replace(key_text(error.key[:2]), key_text(part_key[:2]), 1)
        return RecipeError(message, where=self.where(error.key), hint=error.hint)


def load(
    path: Path,
    variant: str | None,
    model_of: Callable[[Node], type[Recipe]],
    whole: Callable[[], type[Recipe]],
    world: World,
) -> LoadedRecipe:
    """Read, check and (with `variant`) patch one recipe; raises RecipeError, never anything else.

    model_of: the recipe with the keys that a tree may have; whole: with all keys that there are,
    to explain what is wrong. All variants are checked, also those that nobody asked for, and all
    mistakes are reported at once.
    """

    def check(root: Node) -> Recipe:
        return validated(model_of(root), root, RecipeError, whole)

    one = partial(_load, check=check, world=world)
    return _with_parts(one(path, variant), one)


def _load(
    path: Path, variant: str | None, check: Callable[[Node], Recipe], world: World
) -> LoadedRecipe:
    """One recipe without its parts."""
    file = shown_path(path)
    data = read_small_file(path, RecipeError, world)
    refuse_pointer(data, where=Where(file))
    _refuse_robot(data, file)
    root = parse(data, file, RecipeError)
    if not isinstance(root.value, dict):
        actual = described(root)
        hint = "a recipe begins with `schema: assetbuild/v1`"
        raise RecipeError(f"expected a map at the top, found {actual}", where=root.where, hint=hint)
    absolute = Path(os.path.abspath(path))  # noqa: PTH100 # resolve() would follow links
    root, renamed = with_new_keys(with_motor_file(root, absolute, world))
    names = variant_names(root)
    if root.cost * (1 + len(names)) > MAX_COST:
        message = f"too large: {root.cost} values times {len(names)} variants"
        raise RecipeError(message, where=locate(root, ("variants",)))
    wrong = Gather(RecipeError)
    checked: dict[str | None, tuple[Recipe, Node]] = {}
    for name in dict.fromkeys((None, *names, variant)):
        with wrong:
            tree = root if name is None else patched(root, name)
            checked[name] = check(tree), tree
    wrong.stop()
    recipe, tree = checked[variant]
    return LoadedRecipe(recipe, absolute, file, variant, tree, world, renamed)


def _refuse_robot(data: bytes, file: str) -> None:
    """RecipeError for a robot's description where its recipe was to be named."""
    if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return
    kind = "a URDF" if re.search(rb"<robot\b", data) else "an MJCF"
    if kind == "an MJCF" and not re.search(rb"<mujoco\b", data):
        return
    if kind == "a URDF" and (file.endswith(".xacro") or b"xmlns:xacro" in data):
        kind = "a xacro file"
    hint = f"write a recipe for it: `assetbuild init {file}`"
    raise RecipeError(f"this is {kind}, not a recipe", where=Where(file), hint=hint)


One = Callable[[Path, str | None], LoadedRecipe]


def _with_parts(loaded: LoadedRecipe, load_one: One) -> LoadedRecipe:
    """Load the recipes of its parts; RecipeError for a part that has parts itself."""
    parts: list[LoadedRecipe] = []
    wrong = Gather(RecipeError)
    for index, row in enumerate(loaded.recipe.compose):
        with wrong:
            parts.append(_part_of(loaded, index, row, load_one))
    wrong.stop()
    return replace(loaded, parts=tuple(parts))


def _part_of(loaded: LoadedRecipe, index: int, row: Part, load_one: One) -> LoadedRecipe:
    """A part with a recipe; of one that is a source alone, the whole's recipe has the tables."""
    name, key, whole = row.recipe, ("compose", index, "recipe"), loaded.recipe
    if name is None:
        collision = {"preset": whole.collision.preset, "default": whole.collision.default}
        given = {"schema": "assetbuild/v1", "robot": row.as_.strip("_") or row.as_}
        recipe = type(whole).model_validate({**given, "source": row.source, "collision": collision})
        _, tree, _ = follow(loaded.tree, key[:2])
        return replace(loaded, recipe=recipe, tree=tree, renamed=(), parts=(), inline=True)
    path = Path(os.path.normpath(loaded.path.parent / name))
    if path == loaded.path or not loaded.world.is_file(path):
        problem = "is this recipe itself" if path == loaded.path else "there is no such file"
        beside = loaded.world.names(path.parent, ends=(".yaml",))
        near = [one for one in beside if path.parent / one != loaded.path]
        raise loaded.error(key, f"`{name}`: {problem}", did_you_mean(path.name, near))
    part = load_one(path, row.variant)
    if part.recipe.compose:
        hint = "list all parts in one recipe"
        raise loaded.error(key, f"`{name}` is composed of parts itself", hint)
    return part


def with_motor_file(root: Node, recipe: Path, world: World) -> Node:
    """The recipe's tree with the motors of its `motor_file` below its own.

    Each motor keeps the line it came from. RecipeError for a file that is no map of motors.
    """
    entries = dict(root.value) if isinstance(root.value, dict) else {}
    named = entries.get("motor_file")
    if named is None or not isinstance(named.node.value, str):
        return root  # a wrong type is reported with all other errors of the recipe
    path = Path(os.path.normpath(recipe.parent / named.node.value))
    hint = "a motor file is a map of motors: `go1_hip: {gear: 6, effort: 23.7}`"
    motors = read_map(path, RecipeError, world, "a map", hint)
    assert isinstance(motors.value, dict)  # noqa: S101 # that is what it is
    recipe_motors = entries.get("motors")
    if recipe_motors is None:
        entries["motors"] = Entry(motors.where, motors)
    elif isinstance(recipe_motors.node.value, dict):
        merged = Node(recipe_motors.node.where, {**motors.value, **recipe_motors.node.value})
        entries["motors"] = Entry(recipe_motors.where, merged)
    return Node(root.where, entries, cost=root.cost + motors.cost, height=root.height)


def shown_path(path: Path) -> str:
    """A path for people: relative to the working folder when below it, else as given."""
    below = path.is_relative_to(Path.cwd())
    return (path.relative_to(Path.cwd()) if below else path).as_posix()


def read_map(
    path: Path, error: type[AssetBuildError], world: World | None, what: str, hint: str
) -> Node:
    """The tree of a YAML file that is a map. what: `a map` in words that say where."""
    root = parse(read_small_file(path, error, world), shown_path(path), error)
    if not isinstance(root.value, dict):
        raise error(f"expected {what}, found {described(root)}", where=root.where, hint=hint)
    return root


def read_small_file(path: Path, error: type[AssetBuildError], world: World | None = None) -> bytes:
    """The bytes of a regular file; `error` for one that is missing, no file, or too long.

    world: of a build, which notes that it asked.
    """
    where, world = Where(shown_path(path)), world or World()
    world.is_file(path)
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise error("this is a folder, not a file", where=where)
        if not stat.S_ISREG(status.st_mode):  # a pipe would make us wait for ever
            raise error("this is not a regular file", where=where)
        if status.st_size > MAX_BYTES:
            raise error(f"the file is longer than {MAX_BYTES >> 20} MB", where=where)
        data = path.read_bytes()
        world.saw(path, data)
        return data
    except FileNotFoundError:
        raise error("there is no such file", where=where) from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise error(f"cannot be read: {reason}", where=where) from None
