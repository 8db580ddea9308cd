"""What a policy's files say, beside a bundle: each difference as a finding that names the wire."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from assetbuild.errors import did_you_mean, quoted
from assetbuild.findings import Finding, Rule
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import ByJoint, Policy
from assetbuild.policy.terms import sees, unknown, width
from assetbuild.robot.orders import breadth_first
from assetbuild.robot.twins import other_side

JOINTS = Rule(
    "policy.joints",
    ("error", "info"),
    "a policy drives joints that the robot does not have, or leaves some to themselves",
    "take the bundle of the robot that it was trained on",
)
SHAPE = Rule(
    "policy.shape",
    "error",
    "a policy's network takes or gives another number of values than its files describe",
    "compare the list of observations, their histories and the joints of the action",
)
TERM = Rule(
    "policy.term",
    "error",
    "a policy sees an observation that nothing here computes",
    "only observations of a robot on a flat floor can be replayed",
)
ORDER = Rule(
    "policy.order",
    "warning",
    "a policy counts the joints in an order that is none of the engines', or not the one that its "
    "own trainer has",
    "see `orders` in the contract, `policy/<robot>_contract.yaml`",
)
GAINS = Rule(
    "policy.gains",
    ("warning", "info"),
    "gains of a policy are not those of the bundle (warning: exchanged, in another order, of "
    "another unit, or a few of them)",
    "drive the robot with the policy's own gains, or build the bundle with them",
)
POSITION = Rule(
    "policy.position",
    ("warning", "info"),
    "the default pose of a policy is not the one in which the bundle starts (warnings as above)",
    "the pose belongs to the policy: its observations and actions count from it",
)
SCALE = Rule(
    "policy.scale",
    ("warning", "info"),
    "action scales differ from the bundle's, from one side to the other, or have another sign",
    "take the scale of the training's configuration",
)
OFFSET = Rule(
    "policy.offset",
    ("warning", "info"),
    "actions count from another pose than joint positions do",
    "with Isaac Lab's `use_default_offset` both are the default pose",
)
TIMESTEP = Rule(
    "policy.timestep",
    ("warning", "info"),
    "a policy acts in another rhythm than the bundle's recipe states (information: it states none)",
    "`simulation: {timestep: ..., decimation: ...}`",
)
QUATERNION = Rule(
    "policy.quaternion",
    "warning",
    "the start pose of a policy is upright only in the other order of a quaternion's numbers",
    "Isaac Lab 2 takes w, x, y, z, Isaac Lab 3 and PhysX x, y, z, w",
)
ENGINES = {"mujoco": "MuJoCo's", "isaaclab": "Isaac Lab's", "bus": "the motor bus's"}
"""Orders that differ from one another, as findings call them."""
FEW = 1.0 / 3.0
"""Up to this share of the joints whose number is not 0, a difference is one of single joints."""
SHOWN, MORE = 4, " and {} more"
UNIT_SLIPS = {
    math.degrees(1.0): "57.3 times as large, as if it were in degrees",
    math.radians(1.0): "57.3 times too small, as if it were per degree",
}
SLIP = 1e-3


@dataclass(frozen=True)
class Column:
    """One number of each joint. values: the policy's; reference: what they are compared with.

    against: what `reference` is, in words. own_use: a policy may have numbers of its own, so that a
    difference of most of them is none in the wiring.
    """

    rule: Rule
    what: str
    values: ByJoint
    reference: ByJoint
    against: str = "the bundle"
    own_use: bool = True


def compare(policy: Policy, bot: Bot, sizes: tuple[int, int] | None = None) -> Iterator[Finding]:
    """All findings. sizes: (inputs, outputs) of the network, where it was asked."""
    yield from _joints(policy, bot)
    yield from _terms(policy, bot)
    if sizes is not None:
        yield from _shape(policy, sizes)
    yield from _order(policy, bot)
    start = {name: bot.position[name] for name in policy.joints if name in bot.position}
    pose = {name: policy.position[name] for name in policy.acts_on}
    for column in (
        Column(GAINS, "kp", policy.kp, bot.kp),
        Column(GAINS, "kd", policy.kd, bot.kd),
        Column(POSITION, "default position", policy.position, start),
        Column(OFFSET, "offset of the action", policy.offset, pose, "its default pose", False),
        Column(SCALE, "action scale", policy.scale, {}),
    ):
        yield from _column_findings(column, policy, bot)
    if policy.step_s is None:
        text = f"it does not state how often it acts: every {1e3 * bot.step_s:.4g} ms in the bundle"
        yield TIMESTEP("policy", text, severity="info")
    elif not policy.same(policy.step_s, bot.step_s):
        yield TIMESTEP(
            "policy",
            f"it acts every {1e3 * policy.step_s:.4g} ms; the bundle's recipe says every "
            f"{1e3 * bot.step_s:.4g} ms",
            data={"policy_s": policy.step_s, "bundle_s": bot.step_s},
        )
    silent = [n for n in policy.acts_on if n not in policy.kp or n not in policy.kd]
    if silent:
        text = f"it does not state the gains of {quoted(silent, SHOWN, MORE)}: the bundle's hold"
        yield GAINS("policy", text, severity="info", data={"joints": tuple(silent)})
    if policy.kp and all(policy.kd.get(name, 0.0) > abs(kp) for name, kp in policy.kp.items()):
        yield GAINS("policy", "kd is above kp at every joint, as if they were exchanged")
    yield from _outside(policy, bot)
    quat = policy.start_quat
    if quat is not None and abs(quat[3]) > abs(quat[0]) and abs(quat[3]) > 1.0 - SLIP:
        turn = ", ".join(f"{value:.4g}" for value in quat)
        yield QUATERNION("policy", f"the base starts turned by ({turn}), w first")


def _outside(policy: Policy, bot: Bot) -> Iterator[Finding]:
    """A default pose that the joints cannot take is none that anybody trained with."""
    for name in policy.joints:
        joint = bot.tree.by_joint.get(name)
        if joint is None or joint.range is None:
            continue
        value, (low, high) = policy.position[name], joint.range
        if not low - SLIP <= value <= high + SLIP:
            text = f"its default position {value:.4g} is outside of its limits"
            yield POSITION(f"joint {name}", f"{text}, {low:.4g} to {high:.4g}")


# --- joints, observations -------------------------------------------------------------------------


def _joints(policy: Policy, bot: Bot) -> Iterator[Finding]:
    known = bot.orders["urdf"]
    for name in policy.joints:
        if name not in known:
            hint = did_you_mean(name, known)
            yield JOINTS(f"joint {name}", "the robot has no such joint", hint)
        elif name in policy.acts_on and name not in bot.driven:
            yield JOINTS(f"joint {name}", "the policy drives it, the bundle has no drive there")
    left = [name for name in bot.driven if name not in policy.acts_on]
    if left:
        text = f"it leaves {len(left)} driven joints alone: {quoted(left, SHOWN, MORE)}"
        yield JOINTS("policy", text, severity="info", data={"joints": tuple(left)})


def _terms(policy: Policy, bot: Bot) -> Iterator[Finding]:
    for term in policy.terms:
        if why := bot.cannot_see(term):
            yield TERM(f"observation {term.name}", why)
        elif len(term.scale) not in (1, width(term, policy)):
            text = f"{len(term.scale)} scales for {width(term, policy)} numbers"
            yield SHAPE(f"observation {term.name}", text)
        elif min(term.scale) <= 0.0:
            text = f"its scale is {min(term.scale):g}: seen with the other sign, or not at all"
            yield SCALE(f"observation {term.name}", text)


def _shape(policy: Policy, network: tuple[int, int]) -> Iterator[Finding]:
    inputs, outputs = network
    if not any(map(unknown, policy.terms)) and inputs != sees(policy):
        parts = ", ".join(f"{t.name} {width(t, policy) * t.history}" for t in policy.terms)
        text = f"the network takes {inputs} numbers, the observations are {sees(policy)}: {parts}"
        yield SHAPE("policy", text, data={"takes": inputs, "described": sees(policy)})
    if outputs != len(policy.acts_on):
        text = f"the network gives {outputs} numbers, the actions move {len(policy.acts_on)} joints"
        yield SHAPE("policy", text, data={"gives": outputs, "described": len(policy.acts_on)})


# --- orders ---------------------------------------------------------------------------------------


def orders_of(policy: Policy, bot: Bot) -> dict[str, tuple[str, ...]]:
    """The orders in which the policy's joints may stand, by engine, without repetitions."""
    orders: dict[str, tuple[str, ...]] = {}
    for engine in ENGINES:
        order = tuple(name for name in bot.orders[engine] if name in policy.joints)
        if engine == "isaaclab":  # the policy's robot may lack joints of this one
            order = breadth_first(bot.tree, policy.joints)
        if len(order) == len(policy.joints) and order not in orders.values():
            orders[engine] = order
    return orders


def _order(policy: Policy, bot: Bot) -> Iterator[Finding]:
    """Places on a bus may follow any engine; where the trainer is known, they follow its own."""
    known = orders_of(policy, bot)
    wanted = [known[policy.follows]] if policy.follows in known else [*known.values()]
    if not known or policy.joints in wanted:
        return
    if not policy.follows and not bot.states_bus:
        text = "it counts motors of a bus whose order the bundle does not state: URDF order used"
        hint = "add the target `policy` and `policy: {bus_order: [...]}` to the recipe"
        yield ORDER("policy", text, hint)
        return
    elsewhere = {
        engine: [a for a, b in zip(policy.joints, order, strict=True) if a != b]
        for engine, order in known.items()
    }
    engine, off = min(elsewhere.items(), key=lambda pair: len(pair[1]))
    if not off:
        text = f"the joints stand in {ENGINES[engine]} order; its trainer counts them otherwise"
    else:
        listed = quoted(off, SHOWN, MORE)
        text = f"the joints stand in no engine's order; {ENGINES[engine]}, but for {listed}"
    yield ORDER("policy", text, data={"nearest": engine, "joints": tuple(off)})


# --- numbers --------------------------------------------------------------------------------------


def _column_findings(column: Column, policy: Policy, bot: Bot) -> Iterator[Finding]:
    """What differs, and what slip would explain it."""
    names = [name for name in policy.joints if name in column.values and name in column.reference]
    differ = [n for n in names if not policy.same(column.values[n], column.reference[n])]
    if not differ:
        yield from _sides(column, policy, names)
        return
    used = [name for name in names if column.values[name] or column.reference[name]]
    data = {"joints": tuple(differ)}
    message = _explained(column, names, differ, policy, bot)
    if message:
        yield column.rule("policy", message, severity="warning", data=data)
    elif len(differ) <= max(1, FEW * len(used)) or not column.own_use:
        text = "; ".join(_both(column, name) for name in differ[:SHOWN])
        more = f"; and {len(differ) - SHOWN} more" if len(differ) > SHOWN else ""
        message = f"{column.what} differs from {column.against}: {text}{more}"
        yield column.rule(f"joint {differ[0]}", message, severity="warning", data=data)
    else:
        text = f"{column.what} of {len(differ)} of {len(names)} joints is the policy's own"
        yield column.rule(
            "policy", f"{text}: {_both(column, differ[0])}, ...", severity="info", data=data
        )
        yield from _sides(column, policy, names)


def _explained(
    column: Column, names: list[str], differ: list[str], policy: Policy, bot: Bot
) -> str:
    """What slip would make the column the other; "" where none would."""
    values, reference, what = column.values, column.reference, column.what

    def fits(changed: Mapping[str, float]) -> bool:
        return all(policy.same(changed[name], reference[name]) for name in names)

    sides = sides_of(names)
    if sides and fits({name: values[sides.get(name, name)] for name in names}):
        return f"{what} of left and right is exchanged"
    known = {
        engine: [n for n in order if n in names] for engine, order in orders_of(policy, bot).items()
    }
    stated = [name for name in policy.joints if name in names]
    for engine, order in known.items():
        if fits({there: values[here] for here, there in zip(stated, order, strict=True)}):
            return f"{what} is listed in {ENGINES[engine]} order, the file declares another"
    for other, order in known.items():
        if fits({here: values[there] for here, there in zip(stated, order, strict=True)}):
            return f"{what} is read in {ENGINES[other]} order, it was written in the file's own"
    if pairs := _exchanged(column, differ, policy):
        text = ", ".join(f"`{a}` and `{b}`" for a, b in pairs[:SHOWN])
        return f"{what} of {text} {'is' if len(pairs) == 1 else 'are'} exchanged"
    ratios = [values[n] / reference[n] for n in differ if reference[n]]
    if len(ratios) == len(differ) and max(ratios) - min(ratios) <= SLIP * abs(ratios[0]):
        return _factor(column, ratios[0], differ, names)
    return ""


def sides_of(names: Sequence[str]) -> dict[str, str]:
    """The joint on the other side of each that has one."""
    twins = {name: twin for name in names if (twin := other_side(name, names))}
    return twins | {twin: name for name, twin in twins.items()}


def _exchanged(column: Column, differ: list[str], policy: Policy) -> list[tuple[str, str]]:
    """Pairs of joints each of which has the other's number; none unless that explains them all."""
    left, pairs = list(differ), list[tuple[str, str]]()
    while left:
        one = left.pop(0)
        for other in left:
            crossed = ((one, other), (other, one))
            if all(policy.same(column.values[a], column.reference[b]) for a, b in crossed):
                pairs.append((one, other))
                left.remove(other)
                break
        else:
            return []
    return pairs


def _factor(column: Column, ratio: float, differ: list[str], names: list[str]) -> str:
    """A number that all of them are off by; of one alone it would explain nothing."""
    for slip, words in UNIT_SLIPS.items():
        if abs(ratio / slip - 1.0) <= SLIP:
            return f"{column.what} of {_of(differ, names)} is {words}"
    if abs(ratio + 1.0) <= SLIP:
        return f"{column.what} of {_of(differ, names)} has the opposite sign"
    if len(differ) == len(names) > 1:
        return (
            f"{column.what} of {_of(differ, names)} is {ratio:.4g} times that of {column.against}"
        )
    return ""


def _sides(column: Column, policy: Policy, names: Sequence[str]) -> Iterator[Finding]:
    """Joints of both sides that differ in the policy and not in the robot; signs are let be."""
    names, values, reference = names or list(column.values), column.values, column.reference
    odd = []
    for name in names:
        twin = other_side(name, names)
        if twin not in values:
            continue
        alike = abs(abs(reference.get(name, 0.0)) - abs(reference.get(twin, 0.0))) <= SLIP
        if alike and not policy.same(abs(values[name]), abs(values[twin])):
            odd.append((name, twin))
    if odd:
        text = "; ".join(f"`{a}` {values[a]:.4g}, `{b}` {values[b]:.4g}" for a, b in odd[:SHOWN])
        message = f"{column.what} is not the same on both sides: {text}"
        joints = tuple(name for pair in odd for name in pair)
        yield column.rule("policy", message, severity="warning", data={"joints": joints})
    minus = [name for name in names if column.rule is SCALE and values[name] < 0.0]
    if minus:
        listed = quoted(minus, SHOWN, MORE)
        text = f"{column.what} of {listed} is negative: the joint goes the other way"
        yield column.rule("policy", text, severity="warning", data={"joints": tuple(minus)})


def _of(differ: list[str], names: list[str]) -> str:
    return "all joints" if len(differ) == len(names) else quoted(differ, SHOWN, MORE)


def _both(column: Column, name: str) -> str:
    return f"`{name}` {column.values[name]:.4g}, {column.reference[name]:.4g} of {column.against}"
