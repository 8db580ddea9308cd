"""What a policy sees, and the network that acts on it: a stranger's file in its own process."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from policies import save, write_network

from assetbuild.errors import MachineError, UsageError
from assetbuild.policy.network import LARGEST_BYTES, Network
from assetbuild.policy.stated import Policy, Term
from assetbuild.policy.terms import FUNCTIONS, Now, Observer, Seen, width


def test_it_answers_what_the_graph_says(tmp_path: Path):
    gain = np.arange(6.0).reshape(3, 2)
    with Network(write_network(tmp_path / "policy.onnx", 3, 2, gain)) as network:
        assert (network.sees, network.acts) == (3, 2)
        for seen in np.eye(3):
            assert network.act(seen) == pytest.approx(seen @ gain)


def vector(name: str, size: int = 2, kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, [1, size])


def test_a_recurrent_network_remembers_until_it_is_reset(tmp_path: Path):
    """h_out = h_in + obs, actions = h_out."""
    nodes = [
        helper.make_node("Add", ["obs", "h_in"], ["h_out"]),
        helper.make_node("Identity", ["h_out"], ["actions"]),
    ]
    into, out = [vector("obs"), vector("h_in")], [vector("actions"), vector("h_out")]
    save(tmp_path / "policy.onnx", helper.make_graph(nodes, "policy", into, out))
    with Network(tmp_path / "policy.onnx") as network:
        one = np.ones(2)
        assert [network.act(one)[0] for _ in range(3)] == [1.0, 2.0, 3.0]
        network.reset()
        assert network.act(one)[0] == 1.0


def garbage(path: Path) -> None:
    path.write_bytes(b"\x08\x07 this is no network")


def strange_operator(path: Path) -> None:
    node = helper.make_node("Evil", ["x"], ["y"], domain="com.stranger")
    graph = helper.make_graph([node], "p", [vector("x")], [vector("y")])
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 13), helper.make_opsetid("com.stranger", 1)]
    )
    onnx.save(model, str(path))


def circle(path: Path) -> None:
    nodes = [helper.make_node("Add", ["x", "z"], ["y"]), helper.make_node("Neg", ["y"], ["z"])]
    save(path, helper.make_graph(nodes, "p", [vector("x")], [vector("y")]))


def data_elsewhere(path: Path) -> None:
    """Weights that it wants to read from a file outside of its own folder."""
    (path.parent.parent / "secret.bin").write_bytes(b"\0" * 24)
    weights = TensorProto(name="W", data_type=TensorProto.FLOAT, dims=[3, 2])
    weights.data_location = TensorProto.EXTERNAL
    weights.external_data.add(key="location", value="../secret.bin")
    node = helper.make_node("MatMul", ["x", "W"], ["y"])
    graph = helper.make_graph([node], "p", [vector("x", 3)], [vector("y")], [weights])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
    model.ir_version = 8
    path.write_bytes(model.SerializeToString())


def whole_numbers(path: Path) -> None:
    ends = [vector("x", 2, TensorProto.INT64)], [vector("y", 2, TensorProto.INT64)]
    save(path, helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "p", *ends))


def no_inputs(path: Path) -> None:
    node = helper.make_node("Constant", [], ["y"], value_floats=[0.0, 0.0])
    save(path, helper.make_graph([node], "p", [], [vector("y")]))


@pytest.mark.parametrize(
    "write", [garbage, strange_operator, circle, data_elsewhere, whole_numbers, no_inputs]
)
def test_what_cannot_be_run_is_one_error_that_names_the_file(write, tmp_path: Path):
    (tmp_path / "p").mkdir()
    write(tmp_path / "p/policy.onnx")
    with pytest.raises(UsageError, match=r"`policy\.onnx` is no network that can be run: \S"):
        Network(tmp_path / "p/policy.onnx")


def test_an_input_that_nothing_feeds_is_refused(tmp_path: Path):
    """A step that it counts by itself: with 0 for ever it would drive somewhere else."""
    node = helper.make_node("Add", ["obs", "time_step"], ["actions"])
    graph = helper.make_graph(
        [node], "p", [vector("obs"), vector("time_step")], [vector("actions")]
    )
    save(tmp_path / "policy.onnx", graph)
    with pytest.raises(UsageError, match="also takes `time_step`, which nothing here computes"):
        Network(tmp_path / "policy.onnx")


def test_a_file_of_gigabytes_is_not_even_opened(tmp_path: Path):
    path = tmp_path / "policy.onnx"
    path.touch()
    os.truncate(path, LARGEST_BYTES + 1)
    with pytest.raises(UsageError, match="has 512 MB"):
        Network(path)


def test_without_onnxruntime_one_line_says_how_to_get_it(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MachineError, match="needs onnxruntime") as raised:
        Network(write_network(tmp_path / "policy.onnx", 3, 2))
    assert raised.value.hint == "pip install 'assetbuild[policy]'"


def test_a_network_that_dies_says_so(tmp_path: Path):
    with Network(write_network(tmp_path / "policy.onnx", 3, 2)) as network:
        network.close()
        with pytest.raises(UsageError, match="does not answer"):
            network.act(np.zeros(3))


# --- What a policy sees, against formulas ---


JOINTS = ("a", "b")
HALF = math.sqrt(0.5)


def seen(time: float = 0.0, q: float = 0.0, quat: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> Seen:
    return Seen(
        time, np.zeros(3), np.array(quat), np.array((1.0, 2.0, 3.0)), np.array((0.1, 0.2, 0.3)),
        {"a": 0.5 + q, "b": -1.0}, {"a": 4.0, "b": 5.0},
    )  # fmt: skip


def now(state: Seen, imu: tuple[np.ndarray, np.ndarray] | None = None) -> Now:
    at = imu or (np.eye(3), np.zeros(3))
    return Now(state, np.array((7.0, 8.0, 9.0)), np.array((-1.0, 1.0)), {"a": 0.5, "b": -0.5}, at)


def policy(*terms: Term, **more: object) -> Policy:
    zero = dict.fromkeys(JOINTS, 0.0)
    return Policy(Path("p"), None, JOINTS, JOINTS, zero, zero, zero, terms, 0.02, **more)


AN_IMU = (np.diag((-1.0, -1.0, 1.0)), np.array((0.0, 0.0, 2.0)))
"""Half a turn about z, and where it sits, m."""
VALUES = {
    # A base that is pitched nose down by a quarter turn has gravity ahead of it.
    "gravity": (
        Term("g", "projected_gravity"), now(seen(quat=(HALF, 0.0, HALF, 0.0))), (1.0, 0.0, 0.0)),
    # v = v0 + w x p, then turned into its frame.
    "an IMU": (
        Term("v", "imu_lin_vel"), now(seen(), AN_IMU), (-(1.0 + 0.4), -(2.0 - 0.2), 3.0)),
    "from the default pose": (
        Term("q", "joint_pos_rel", ("b", "a")), now(seen()), (-0.5, 0.0)),
    "in the term's order": (Term("q", "joint_pos", ("b", "a")), now(seen()), (-1.0, 0.5)),
    "a phase": (
        Term("p", "gait_phase", params={"period": 0.8}), now(seen(time=0.2)), (1.0, 0.0)),
}  # fmt: skip


@pytest.mark.parametrize("what", VALUES)
def test_a_term_is_what_its_formula_says(what: str):
    term, at, expected = VALUES[what]
    assert FUNCTIONS[term.function](at, term) == pytest.approx(np.array(expected))


def test_it_clips_before_it_scales_unless_the_file_says_otherwise():
    term = Term("c", "velocity_commands", scale=(2.0, 1.0, 1.0), clip=(-8.0, 8.0))
    assert Observer(policy(term)).look(now(seen())) == pytest.approx(np.array((14.0, 8.0, 8.0)))
    first = Observer(policy(term, scale_first=True))
    assert first.look(now(seen())) == pytest.approx(np.array((8.0, 8.0, 8.0)))


def test_histories_begin_full_and_have_the_oldest_first():
    terms = Term("q", "joint_pos", ("a",), history=3), Term("a", "last_action", history=2)
    observer = Observer(policy(*terms))
    assert observer.look(now(seen())).tolist() == [0.5, 0.5, 0.5, -1.0, 1.0, -1.0, 1.0]
    assert observer.look(now(seen(q=1.0))).tolist()[:3] == [0.5, 0.5, 1.5]
    terms = Term("q", "joint_pos", ("a",), history=2), Term("a", "last_action", history=2)
    observer = Observer(policy(*terms, by_time=True))
    observer.look(now(seen()))
    assert observer.look(now(seen(q=1.0))).tolist() == [0.5, -1.0, 1.0, 1.5, -1.0, 1.0]


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_term_has_as_many_numbers_as_it_says(function: str):
    joints = JOINTS if function.startswith("joint_") else ()
    term = Term("t", function, joints, params={"period": 1.0})
    told = policy(term)
    assert len(Observer(told).look(now(seen()))) == width(term, told)
