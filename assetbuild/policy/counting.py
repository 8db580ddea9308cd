"""How an engine counts the joints, against what the policy's contract says of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators.experiments import SimulatorCheck, drop

Contract = Mapping[str, Any]  # Any: YAML
WRONG = Rule(
    "policy.engine_order",
    "error",
    "an engine counts the joints in another order than the policy's contract says",
    "if nobody edited the bundle, this is a bug: please report it",
)


class OrdersCheck(SimulatorCheck):
    """Base of the checks that ask an engine which reads USD in which order it has the joints."""

    needs: ClassVar[tuple[str, ...]] = ("policy", "usd")
    reads: ClassVar[tuple[str, ...]] = ("control.json",)
    order: ClassVar[str]
    """What the contract calls the engine's order."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Takes one step, which lists the joints as the engine counts them. StepError."""
        control = RobotFiles(files.inputs).control
        fall = drop(control, control.simulation.timestep)
        done = self.perform(files.inputs, [fall])[fall.name]
        if done.motion is None:
            raise StepError(f"{self.engine} does not take the USD: {done.failure}")
        write_figures(files, {"joints": len(done.motion.joints)})
        contract = read_contract(files.inputs / "policy")
        yield from order_findings(contract, self.order, list(done.motion.joints))


def known_joints(contract: Contract, counted: Sequence[str]) -> list[str]:
    """Those that the contract has as well: joints that are split have other names."""
    return [name for name in counted if name in contract["joints"]]


def order_findings(contract: Contract, engine: str, counted: Sequence[str]) -> Iterator[Finding]:
    """The first place at which an engine's order and the contract's are not the same.

    engine: as the contract calls it; counted: names of joints as that engine has them.
    """
    there = known_joints(contract, counted)
    stated = [name for name in contract["orders"][engine] if name in there]
    for place, (one, other) in enumerate(zip(stated, there, strict=True)):
        if one != other:
            text = f"{engine} has `{other}` at place {place}, where the contract has `{one}`"
            yield WRONG("robot", text, data={"place": place})
            return


def read_contract(folder: Path) -> Contract:
    """The contract in the folder `policy/`."""
    return read_yaml(next(iter(sorted(folder.glob("*_contract.yaml")))))
