"""The pages of rules: an index, and a page for each family."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType

import assetbuild
from assetbuild.findings import Rule

INTRODUCTION = """\
# Rules

Every finding has a rule. A recipe may change the severity of a rule under `rules:`, with a reason;
the finding stays visible.

```yaml
rules: {inertia.radius: {severity: info, because: "carbon tube"}}
```

`*` stands for a part that names what differs. Where a rule has several severities, the usual one
comes first. A robot is not ready where an error is found, or a warning that blocks: of the rules
marked here, and of others in the cases that their meaning names. A finding on the source that an
edit or the actuator table answers is information, and names it.

- The limits behind the rules are keys of the recipe: `validate.inertia`, `validate.gains`,
  `validate.stand`, `validate.free_fall`, `validate.trials`, `validate.mass`, `validate.mirror`.
- `inertia.*` rules judge the links of the source (a warning at most), and the merged bodies that
  will be simulated. Of mass, positive, triangle and pseudo only the first that is broken is
  reported.
- `edit.*` findings record what each edit of the recipe changed: the values before and after.
- `assetbuild validate FILE` applies the rules to a file without a recipe: it simulates any MJCF; a
  URDF with the recipe that `init` would write, its meshes as hulls; a USD in PhysX, where
  `assetbuild[physx]` is installed. `--static` only reads the file.
- `assetbuild sample` reports `randomize.*`; `assetbuild smoke` and `validate.smoke` report
  `smoke.*` and `equal.newton.*`, after another program has tried the bundle.
- Robots are never quite symmetric, so `mirror.*` findings are information; a difference that looks
  like a mistake is a warning.
- `physx.*`, `equal.physx.*` and `alignment.physx.*` need `validate.simulators: [mujoco, physx]` and
  `pip install 'assetbuild[physx]'`. Their messages stay out of job summaries and of what is printed
  in CI: the licence of PhysX does not allow its figures to be published.

"""


@dataclass(frozen=True)
class Entry:
    """A rule, and the modules that declare or import it, by name."""

    rule: Rule
    modules: tuple[ModuleType, ...]

    @property
    def family(self) -> str:
        """The first part of the id."""
        return self.rule.id.partition(".")[0]


def package_modules() -> Iterator[ModuleType]:
    """All modules of this package, imported; children that are programs of their own left out."""
    for found in pkgutil.walk_packages(assetbuild.__path__, "assetbuild."):
        if not found.name.endswith(("_child", "__main__")):
            yield importlib.import_module(found.name)


def entries_of(modules: Iterable[ModuleType]) -> tuple[Entry, ...]:
    """The rules that the modules hold as constants, by id; ValueError for one declared twice."""
    found: dict[str, Entry] = {}
    for module in sorted(modules, key=lambda module: module.__name__):
        for rule in vars(module).values():
            if isinstance(rule, Rule):
                known = found.get(rule.id, Entry(rule, ()))
                if known.rule is not rule:
                    first = known.modules[0].__name__
                    raise ValueError(f"`{rule.id}` is declared in {first} and {module.__name__}")
                found[rule.id] = Entry(rule, (*known.modules, module))
    return tuple(found[rule] for rule in sorted(found))


def rule_pages(entries: Iterable[Entry]) -> Mapping[str, str]:
    """Path below docs/reference -> text: an index, and a page per family."""
    families: dict[str, list[Entry]] = {}
    for entry in entries:
        families.setdefault(entry.family, []).append(entry)
    pages = {f"rules/{family}.md": _page(family, held) for family, held in families.items()}
    return {"rules.md": _index(families), **pages}


def _index(families: Mapping[str, list[Entry]]) -> str:
    rows = [
        f"| [{family}](rules/{family}.md) | {', '.join(f'`{entry.rule.id}`' for entry in held)} |\n"
        for family, held in sorted(families.items())
    ]
    return INTRODUCTION + "| family | rules |\n| --- | --- |\n" + "".join(rows)


def _page(family: str, held: list[Entry]) -> str:
    modules = {module.__name__: module for entry in held for module in entry.modules}
    named = [f"- `{name}`: {_summary(modules[name])}\n" for name in sorted(modules)]
    return (
        f"# Rules `{family}.*`\n\n"
        "[All rules](../rules.md), and how a recipe changes their severity.\n\n"
        "| rule | severity | meaning | what to do |\n| --- | --- | --- | --- |\n"
        + "".join(_row(entry.rule) for entry in held)
        + "".join(_old_names(entry.rule) for entry in held)
        + "\nIn the code:\n\n"
        + "".join(named)
    )


def _row(rule: Rule) -> str:
    severities = ", ".join(rule.severities) + (" (blocks)" if rule.blocks else "")
    cells = (f"`{rule.id}`", severities, rule.meaning, rule.remedy)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _old_names(rule: Rule) -> str:
    """What recipes may still call it, for one minor version."""
    if not rule.was:
        return ""
    named = ", ".join(f"`{old}`" for old in sorted(rule.was))
    return f"\nOld names that `rules:` in a recipe may still use for `{rule.id}`: {named}.\n"


def _summary(module: ModuleType) -> str:
    """The first paragraph of its docstring, on one line."""
    return " ".join((module.__doc__ or "").partition("\n\n")[0].split())
