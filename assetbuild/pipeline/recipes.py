"""Recipes read with the keys of the plug-ins that they name.

`recipe/` declares what every robot has; a target, check, edit or collision method declares its own
keys, and here they become one model: so a recipe is checked, explained and described whole.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union

from pydantic import BaseModel, Discriminator, Field, Tag, create_model
from pydantic_core import PydanticUndefined

from assetbuild.collision import CollisionMethod
from assetbuild.engine.world import World
from assetbuild.facts.reader import Reader
from assetbuild.geometry.jobs import BUILT_IN
from assetbuild.plugin_types import Check, Edit, Plugin, Target
from assetbuild.plugins import foreign_names, load_plugin, own_names, plugin_names, usable_plugins
from assetbuild.recipe.loader import LoadedRecipe, load
from assetbuild.recipe.models import Collision, CollisionRule, OneEdit, Recipe, ShapedRule, Validate
from assetbuild.recipe.schema import schema_of
from assetbuild.recipe.yaml_tree import Node, plain
from assetbuild.recipe_types import Model, Pattern, unstated

Fields = dict[str, Any]  # Any: what create_model takes
M = TypeVar("M", bound=BaseModel)
LISTS = ("linters", "smoke")
"""Lists of `validate` that name checks."""


def load_recipe(
    path: Path | str, variant: str | None = None, world: World | None = None
) -> LoadedRecipe:
    """Read, check and (with `variant`) patch one recipe; raises RecipeError, never anything else.

    All variants are checked, also those that nobody asked for. world: where it is read from.
    """
    return load(Path(path), variant, model_of, whole_model, world or World())


def schema_text() -> str:
    """What `assetbuild schema` prints: JSON Schema of recipes with the keys of every plug-in."""
    return schema_of(whole_model())


def whole_model() -> type[Recipe]:
    """A recipe that may name any plug-in; one that cannot be loaded is left out, with a warning."""
    foreign = {kind: set(foreign_names(kind)) for kind in (Check, Reader)}
    return _model(
        _Named(
            _names(usable_plugins(Target)),
            _names(usable_plugins(Edit)),
            (*_names(usable_plugins(CollisionMethod)), *BUILT_IN),
            _names(each for each in usable_plugins(Check) if each[0] in foreign[Check]),
            _names(each for each in usable_plugins(Reader) if each[0] in foreign[Reader]),
        ),
        any_recipe=True,
    )


def model_of(root: Node) -> type[Recipe]:
    """A recipe with the keys of the plug-ins that its tree names; no other is imported."""
    return _model(_named(_map(plain(root))))


def collision_rule(**keys: object) -> CollisionRule:
    """The rule with these keys of a method, as a recipe would state it."""
    return _rule(str(keys.get("method", "auto"))).model_validate(keys)


# --- which plug-ins a recipe names ----------------------------------------------------------


@dataclass(frozen=True)
class _Named:
    """Names of plug-ins, sorted."""

    targets: tuple[str, ...]
    edits: tuple[str, ...]
    methods: tuple[str, ...]
    checks: tuple[str, ...]
    readers: tuple[str, ...]
    """Like `checks`, those of other distributions: assetbuild's own always count."""


Said = Mapping[str, Any]
"""A recipe as plain data, right or wrong. Any: YAML."""


def _named(content: Said) -> _Named:
    """The plug-ins that a recipe names, in whatever section; names that no plug-in has are left."""
    words = {str(name) for name in _list(content.get("targets"))} | set(content)
    edits = {name for entry in _list(content.get("edits")) for name in _map(entry)}
    targets = tuple(sorted(words & {*plugin_names(Target)}))
    return _Named(
        targets,
        tuple(sorted(edits & {*plugin_names(Edit)})),
        tuple(sorted(_methods(content) & {*plugin_names(CollisionMethod), *BUILT_IN})),
        _named_checks(content),
        _named_readers(targets),
    )


def _named_checks(content: Said) -> tuple[str, ...]:
    """The foreign checks that a recipe asks for, by a key of `validate` or in one of its lists."""
    if not (foreign := {*foreign_names(Check)}):
        return ()
    validate = _map(content.get("validate"))
    asked = set(validate) | {str(word) for key in LISTS for word in _list(validate.get(key))}
    named = asked & foreign
    own = [load_plugin(Check, name) for name in own_names(Check)]
    fields = {info.alias or name for name, info in _validate(_built_in()).model_fields.items()}
    known = fields | {check.listed_as() for check in own if check.listed_in}
    if unknown := asked - named - known:
        named |= {name for name, check in usable_plugins(Check) if unknown & _words(check)}
    return tuple(sorted(named - set(own_names(Check))))


def _words(check: type[Check]) -> set[str]:
    """What a recipe may say below `validate` to ask for a check."""
    paths = {path.removeprefix("validate.") for path in (check.section, *check.sections)}
    keys = set(check.keys()) if check.section == "validate" else set()
    return paths | keys | ({check.listed_as()} if check.listed_in else set())


def _named_readers(targets: Iterable[str]) -> tuple[str, ...]:
    """The foreign readers of the foreign targets that a recipe names."""
    foreign = set(targets) & set(foreign_names(Target))
    if not foreign:
        return ()
    built_in_names = own_names(Reader)
    return _names(
        (name, reader)
        for name, reader in usable_plugins(Reader)
        if name not in built_in_names and foreign & set(reader.needs)
    )


def _names(plugins: Iterable[tuple[str, object]]) -> tuple[str, ...]:
    return tuple(name for name, _ in plugins)


def _methods(content: Said) -> set[str]:
    """The collision methods that rules name, and `auto`."""
    collision = _map(content.get("collision"))
    rules = (collision.get("default"), *_map(collision.get("links")).values())
    return {"auto"} | {str(_map(rule).get("method")) for rule in rules}


def _map(value: object) -> Said:
    return value if isinstance(value, Mapping) else {}


def _list(value: object) -> Sequence[Any]:  # Any: YAML
    return value if isinstance(value, list | tuple) else ()


# --- one model of their keys ----------------------------------------------------------------


@functools.cache
def _model(named: _Named, *, any_recipe: bool = False) -> type[Recipe]:
    """any_recipe: a section that a plug-in needs may be missing, as in a recipe without it."""
    checks = (*_built_in(), *((load_plugin(Check, name), name) for name in named.checks))
    readers = ((load_plugin(Reader, name), name if any_recipe else "") for name in named.readers)
    checks = (*checks, *readers)
    targets = [load_plugin(Target, name) for name in named.targets]
    fields: Fields = {path: field for target in targets for path, field in _sections(target)}
    if any_recipe:
        fields = {
            path: (kind, None if default is PydanticUndefined else default)
            for path, (kind, default) in fields.items()
        }
    validate = _validate(checks)
    target: Any = Literal[tuple(plugin_names(Target))]  # Any: a type made just now
    edit: Any = _of_base(  # Any: a model made just now
        OneEdit, {name: (load_plugin(Edit, name), Field(None)) for name in named.edits}
    )
    collision = _collision(named.methods)
    fields |= {
        "collision": (collision, collision()),
        "edits": (tuple[edit, ...], Recipe.model_fields["edits"]),
        "targets": (tuple[target, ...], Recipe.model_fields["targets"]),
        "validate_": (validate, Field(validate(), alias="validate")),
    }
    model = _of_base(Recipe, fields)
    model.foreign_checks, model.foreign_readers = named.checks, named.readers
    return model


Checks = tuple[tuple[type[Check], str], ...]
"""(check or reader, name that a foreign one has in a recipe; "" for one of assetbuild's own)."""


@functools.cache
def _built_in() -> Checks:
    kinds: tuple[type[Check], ...] = (Check, Reader)
    return tuple((load_plugin(kind, name), "") for kind in kinds for name in own_names(kind))


def _sections(plugin: type[Plugin], foreign: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """(path, field) of every section that a plug-in declares; Any: as in `Fields`.

    foreign: the name of a check that runs only where a recipe states its section.
    """
    for path, name in plugin.sections.items():
        info = plugin.model_fields[name]
        default = None if foreign else info.get_default(call_default_factory=True)
        yield path, (info.annotation, default)
    section = plugin.section
    listed = issubclass(plugin, Check) and plugin.listed_in
    if foreign and not (plugin.keys() or plugin.sections or listed):
        section = f"validate.{foreign}"  # a check without keys: `wind: {}`
    if section != "validate" and (plugin.keys() or section != plugin.section):
        own: Fields = {name: (info.annotation, info) for name, info in plugin.keys().items()}
        keys = create_model(plugin.__name__, __base__=Model, __doc__=plugin.__doc__, **own)
        complete = not any(info.is_required() for info in keys.model_fields.values())
        default = keys() if plugin.enabled_by_default and complete and not foreign else None
        yield section, (keys, Field(default, description=plugin.about or None))


@functools.cache
def _validate(checks: Checks) -> type[Validate]:
    """`validate` with the keys of all checks; null turns a check off."""
    fields: Fields = {}
    for check, foreign in checks:
        for path, (kind, default) in _sections(check, foreign):
            fields[path.removeprefix("validate.")] = (Union[kind, None], default)  # noqa: UP007 # a runtime type
        if check.section == "validate":
            fields |= {name: (info.annotation, info) for name, info in check.keys().items()}
    for key in LISTS:
        names = {check.listed_as() for check, _ in checks if check.listed_in == f"validate.{key}"}
        word: Any = Literal[tuple(sorted(names))]  # Any: a type made just now
        fields[key] = (tuple[word, ...], Validate.model_fields[key])
    return _of_base(Validate, fields)


def _of_base(base: type[M], fields: Fields, name: str = "") -> type[M]:
    """A model with more fields, and the name of the one below it unless it has its own."""
    return create_model(name or base.__name__, __base__=base, __doc__=base.__doc__, **fields)


@functools.cache
def _collision(methods: tuple[str, ...]) -> type[Collision]:
    rules: list[Any] = [Annotated[_rule(name), Tag(f"method {name}")] for name in methods]
    rule: Any = _rule(methods[0])  # Any: a type made just now
    if len(rules) > 1:
        rule = Annotated[functools.reduce(operator.or_, rules), Discriminator(_method)]
    links = Collision.model_fields["links"]
    default = Field(_rule("auto")(), description="of links that no pattern matches")
    return _of_base(Collision, {"default": (rule, default), "links": (dict[Pattern, rule], links)})


def _method(raw: object) -> str:
    stated = raw.get("method") if isinstance(raw, Mapping) else getattr(raw, "method", None)
    return f"method {'auto' if stated is None else stated}"


@functools.cache
def _rule(method: str) -> type[CollisionRule]:
    """The keys of a rule with this method; what it does not state is left to the method."""
    default: Any = "auto" if method == "auto" else ...  # Any: as create_model takes it
    what = Field(default, description=CollisionRule.model_fields["method"].description)
    kind: Any = Literal[method]  # Any: as above
    name = f"{method.title().replace('_', '')}Rule"
    if method in BUILT_IN:
        return _of_base(CollisionRule, {"method": (kind, what)}, name)
    plugin = load_plugin(CollisionMethod, method)
    keys: Fields = {key: (info.annotation, info) for key, info in plugin.keys().items()}
    model = unstated(create_model(f"{name}Keys", __base__=Model, **keys))
    optional: Fields = {key: (info.annotation, info) for key, info in model.model_fields.items()}
    return create_model(
        name, __base__=ShapedRule, __doc__=plugin.__doc__, method=(kind, what), **optional
    )
