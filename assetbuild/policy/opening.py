"""Any policy that people have: a folder, an ONNX file, or the file that describes it."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

from assetbuild.errors import UsageError
from assetbuild.policy.compare import compare
from assetbuild.policy.deploy_yaml import read_deploy
from assetbuild.policy.isaaclab_yaml import read_env
from assetbuild.policy.mjlab_onnx import read_metadata
from assetbuild.policy.network import Network
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy

READERS = {"deploy.yaml": read_deploy, "env.yaml": read_env}
"""Files that describe a policy, by name."""
FOLDERS = (".", "params", "../params", "exported", "../exported")
"""Where they lie, from a policy's own folder; likewise its network."""
BROKEN = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, re.error)
"""What a reader runs into where a file is not of its kind at all."""
STEPS_S = (1e-4, 1.0)
LONGEST = 100
"""Steps that an observation may look back."""


def open_policy(path: Path, bot: Bot) -> Policy:
    """What a policy says of itself. UsageError where nothing describes it, or not in numbers."""
    try:
        policy = _read(path, bot)
    except BROKEN as error:  # a file may hold anything
        text = f"{type(error).__name__}: {error}"
        raise UsageError(f"`{path}` is no policy that can be read: {text}") from None
    numbers = [
        *policy.position.values(), *policy.scale.values(), *policy.offset.values(),
        *policy.kp.values(), *policy.kd.values(), *(v for t in policy.terms for v in t.scale),
    ]  # fmt: skip
    wrong = ""
    if not all(map(math.isfinite, numbers)):
        wrong = "it has numbers that are not finite"
    elif policy.step_s is not None and not STEPS_S[0] <= policy.step_s <= STEPS_S[1]:
        wrong = f"it acts every {policy.step_s:g} s; expected {STEPS_S[0]:g} to {STEPS_S[1]:g}"
    elif len({*policy.joints}) < len(policy.joints):
        wrong = "it names one joint twice"
    for term in policy.terms:
        if not 1 <= term.history <= LONGEST:
            wrong = f"`{term.name}` looks back {term.history} steps; expected 1 to {LONGEST}"
    if wrong:
        raise UsageError(f"`{policy.file.name}`: {wrong}")
    return policy


def _read(path: Path, bot: Bot) -> Policy:
    """A file that is named wins; beside an ONNX file, its `deploy.yaml` or `env.yaml` wins over
    its metadata."""
    if not path.exists():
        raise UsageError(f"no such file or folder: `{path}`")
    folder = path if path.is_dir() else path.parent
    network = path if path.suffix == ".onnx" else _network_in(folder)
    if path.suffix in (".yaml", ".yml"):
        described: Path | None = path
    else:
        described = next(filter(None, (_beside(folder, name) for name in READERS)), None)
    if described is not None:
        reader = READERS.get(described.name) or (read_env if _is_env(described) else read_deploy)
        return reader(described, network, bot)
    if network is None:
        raise UsageError(
            f"`{path}` holds no policy",
            hint="give an ONNX file of mjlab, or a folder with `policy.onnx` and its `deploy.yaml` "
            "or `env.yaml`; `torch.onnx.export` turns a `.pt` into ONNX",
        )
    with Network(network) as loaded:
        metadata = loaded.metadata
    if not {"joint_names", "observation_names"} <= metadata.keys():  # as mjlab writes them
        raise UsageError(
            f"`{network.name}` does not say which joints it drives",
            hint="put its `deploy.yaml` or Isaac Lab's `params/env.yaml` beside it",
        )
    return read_metadata(network, metadata, bot)


def runnable(policy: Policy, bot: Bot) -> Network:
    """The network of a policy that can drive this robot. UsageError where it cannot."""
    if policy.network is None:
        hint = "put `policy.onnx` beside it"
        raise UsageError(f"`{policy.file.name}` has no network to replay", hint=hint)
    network = Network(policy.network)
    for finding in compare(policy, bot, (network.sees, network.acts)):
        if finding.severity == "error":
            network.close()
            raise UsageError(f"{finding.subject}: {finding.message}", hint=finding.hint)
    return network


def _network_in(folder: Path) -> Path | None:
    """`policy.onnx`, else the only network; UsageError where any of several may be meant."""
    network = _beside(folder, "policy.onnx") or _beside(folder, "*.onnx")
    files = sorted(network.parent.glob("*.onnx")) if network else []
    if network and network.name != "policy.onnx" and len(files) > 1:
        listed = ", ".join(f"`{file.name}`" for file in files)
        raise UsageError(f"`{folder}` holds several networks: {listed}", hint="give one of them")
    return network


def _beside(folder: Path, pattern: str) -> Path | None:
    """The first file of a name in the folders of a policy."""
    files = (file for place in FOLDERS for file in sorted((folder / place).glob(pattern)))
    # Not resolved: the inputs of a step are links into the store.
    return next((Path(os.path.normpath(file)) for file in files if file.is_file()), None)


def _is_env(path: Path) -> bool:
    """Whether a file of another name is an environment of Isaac Lab."""
    return b"\nobservations:" in path.read_bytes() and b"class_type:" in path.read_bytes()
