"""`policy/<robot>_contract.yaml`: what a policy must know of the robot."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.derived import start_of
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.facts.reader import Reader, all_but
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Table, Value
from assetbuild.robot.model import Tree

COLUMNS = {
    "default_position": "start", "lower": "lower", "upper": "upper", "model": "model", "kp": "kp",
    "kd": "kd", "effort": "effort", "velocity": "velocity", "armature": "armature",
}  # fmt: skip
"""Lists in the order of `joints` -> the vocabulary's quantities."""


class PolicyFacts(Reader):
    """Orders are words of the format, `policy:mujoco`, with the place of each joint in them."""

    needs: ClassVar[tuple[str, ...]] = ("policy",)
    format_id: ClassVar[str] = "policy"
    display_name: ClassVar[str] = "the policy's contract"
    folder: ClassVar[str] = "policy"
    file_globs: ClassVar[tuple[str, ...]] = ("policy/{robot}_contract.yaml",)
    simulated: ClassVar[bool] = False
    recipe_sections: ClassVar[tuple[str, ...]] = ("policy", "imu")
    lacks: ClassVar[Mapping[str, str]] = all_but(
        (*(f"joint {name}" for name in COLUMNS.values()),
         "simulation timestep", "simulation decimation", "robot base"),
        "stands in the MJCF, USD or URDF beside it",
    )  # fmt: skip

    def read(self, path: Path) -> Table:
        """UsageError for what is no YAML; LookupError, TypeError or ValueError for another file."""
        policy, table = read_yaml(path), Table()
        names = policy["joints"]
        for column, quantity in COLUMNS.items():
            for name, value in zip(names, policy[column], strict=False):
                table.put("joint", name, {quantity: value})
        lengths = {
            f"policy:{column}": float(len(policy[column])) for column in ("joints", *COLUMNS)
        }
        table.put("lists", "", lengths)
        for engine, order in policy["orders"].items():
            for place, name in enumerate(order):
                table.put("joint", name, {f"policy:{engine}": float(place)})
        for engine, places in policy["permutations"].items():
            for name, place in zip(names, places, strict=False):
                table.put("joint", name, {f"policy:from {engine}": float(place)})
        table.put("simulation", "", {key: policy[key] for key in ("timestep", "decimation")})
        base = policy["base"]
        words = {f"policy:base {word}": base[word] for word in ("link", "imu")}
        table.put("robot", "", {"base": base["kind"], **words})
        return table.plain()

    def expected(self, reference: Reference) -> Table:
        """The drives of the joints that move, in every order."""
        tree, table = reference.tree, Table()
        moving = [joint.name for joint in tree.moving_joints]
        start = dict(start_of(tree, reference.control).joints)
        for engine, order in _orders(reference, moving).items():
            for place, name in enumerate(order):
                words: dict[str, Value] = {f"policy:{engine}": float(place)}
                if len(order) == len(moving):
                    words[f"policy:from {engine}"] = float(place)
                table.put("joint", name, words)
        for name in moving:
            table.put("joint", name, {"start": start[name]})
        count = float(len(moving))
        table.put("lists", "", {f"policy:{column}": count for column in ("joints", *COLUMNS)})
        imu = (reference.options.get("imu") or {}).get("link") or tree.root
        table.put("robot", "", {"policy:base link": tree.root, "policy:base imu": imu})
        facts = robot_table(reference).only(
            lambda key: self.holds(key) and (key.kind != "joint" or key.name in moving)
        )
        return facts | table


def _orders(reference: Reference, moving: list[str]) -> dict[str, list[str]]:
    """Each as paths from the root that are sorted: by name along the limbs, by depth before it."""
    paths = {name: _path(reference.tree, name) for name in moving}
    bus = list((reference.options.get("policy") or {}).get("bus_order") or moving)
    limbs = sorted(moving, key=lambda name: paths[name])
    levels = sorted(moving, key=lambda name: (len(paths[name]), paths[name]))
    return {"urdf": moving, "mujoco": moving, "newton": limbs, "isaaclab": levels, "bus": bus}


def _path(tree: Tree, joint: str) -> tuple[str, ...]:
    """Names of the joints from the root to this one, as USD spells them."""
    above, joints = tree.joint_above, [joint]
    while (link := tree.by_joint[joints[0]].parent) in above:
        joints.insert(0, above[link].name)
    return tuple(re.sub("^(?=[0-9])", "_", re.sub("[^A-Za-z0-9_]", "_", name)) for name in joints)
