"""A compiled MuJoCo model out of the arrays that another process sent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np


class HeldModel:
    """The compiled model that Newton's solver holds, to be read as `mujoco.MjModel`."""

    def __init__(self, held: Mapping[str, Any]) -> None:  # Any: JSON
        self.opt = SimpleNamespace(**_arrays(held["opt"]))
        for kind, names in held["names"].items():
            held = {**held, kind: partial(_named, names)}
        self.__dict__ |= _arrays(held)


def _arrays(values: Mapping[str, Any]) -> dict[str, Any]:  # Any: JSON; arrays and numbers
    return {k: np.array(v) if isinstance(v, list) else v for k, v in values.items() if k != "opt"}


def _named(names: Sequence[str], index: int) -> SimpleNamespace:
    return SimpleNamespace(name=names[index])
