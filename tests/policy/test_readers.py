"""Policies as people have them: deploy.yaml, Isaac Lab's env.yaml, mjlab's metadata."""

from __future__ import annotations

import math
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper
from policies import BUS, bundle_of, deployed, save, write_network, write_policy
from random_robots import examples

from assetbuild.errors import UsageError
from assetbuild.policy.compare import compare
from assetbuild.policy.opening import open_policy
from assetbuild.policy.reading import read_yaml
from assetbuild.policy.robot import Bot
from assetbuild.policy.terms import sees

ENV = """\
sim: {dt: 0.005, gravity: !!python/tuple [0.0, 0.0, -9.81]}
decimation: 4
scene:
  robot:
    init_state:
      rot: !!python/tuple [1.0, 0.0, 0.0, 0.0]
      joint_pos: {".*_hip_joint": 0.1, ".*_thigh_joint": 0.9, ".*_calf_joint": -1.8}
    actuators:
      legs: &legs
        class_type: isaaclab.actuators.actuator_pd:DCMotor
        joint_names_expr: [".*_hip_joint", ".*_thigh_joint"]
        stiffness: {".*_hip_joint": 20.0, ".*_thigh_joint": 25.0}
        damping: 0.5
      calves:
        joint_names_expr: [".*_calf_joint"]
        stiffness: 30.0
        damping: 0.75
  again: *legs
observations:
  policy:
    concatenate_terms: true
    history_length: null
    base_ang_vel: {func: "isaaclab.envs.mdp.observations:base_ang_vel", params: {}, scale: 0.2}
    velocity_commands: {func: "isaaclab.envs.mdp.observations:generated_commands", params: {}}
    joint_pos: {func: "isaaclab.envs.mdp.observations:joint_pos_rel", params: {}, history_length: 3}
    actions: {func: "isaaclab.envs.mdp.observations:last_action", clip: !!python/tuple [-5.0, 5.0]}
    phase: {func: "strangers.mdp.observations:gait_phase", params: {period: 0.8}}
actions:
  joint_pos:
    class_type: isaaclab.envs.mdp.actions.joint_actions:JointPositionAction
    joint_names: [".*"]
    scale: {".*_hip_joint": 0.125, "^(?!.*hip).*": 0.25}
    use_default_offset: true
    clip: {".*_hip_joint": !!python/tuple [-0.5, 0.5]}
    joint_ids: !!python/object/apply:builtins.slice [null, null, null]
"""


@pytest.fixture(scope="module")
def bot(tmp_path_factory: pytest.TempPathFactory) -> Bot:
    return bundle_of(tmp_path_factory.mktemp("bundle"))


def test_deploy_yaml_counts_motors_on_the_bus(bot: Bot, tmp_path: Path):
    said = deployed(bot) | {"stiffness": [float(i) for i in range(12)]}
    policy = open_policy(write_policy(tmp_path / "p", said), bot)
    assert policy.joints == bot.orders["isaaclab"]
    assert policy.kp == {name: float(place) for place, name in enumerate(BUS)}
    assert policy.position["RR_calf_joint"] == bot.position["RR_calf_joint"]
    assert policy.step_s == bot.step_s and sees(policy) == 9 + 36


def test_a_scale_may_be_one_number_of_a_whole_observation(bot: Bot, tmp_path: Path):
    said = deployed(bot)
    said["observations"]["joint_vel_rel"] |= {"scale": 0.05, "clip": [-100, 100]}
    term = open_policy(write_policy(tmp_path, said), bot).terms[4]
    assert (term.name, term.scale, term.clip) == ("joint_vel_rel", (0.05,), (-100.0, 100.0))


def test_a_policy_is_found_by_its_folder_its_network_or_its_file(bot: Bot, tmp_path: Path):
    folder = tmp_path / "run"
    (folder / "params").mkdir(parents=True)
    (folder / "exported").mkdir()
    (folder / "params/deploy.yaml").write_text(yaml.safe_dump(deployed(bot), sort_keys=False))
    network = write_network(folder / "exported/policy.onnx", 45, 12)
    for path in (folder, network, folder / "params/deploy.yaml"):
        assert open_policy(path, bot).network == network


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("joint_ids_map", [0, 1, 40], "`40` is no place among 12 joints"),
        ("joint_ids_map", [0, 0], "it names one place twice"),
        ("joint_ids_map", None, "joint_ids_map: it is missing"),
        ("joint_ids_map", "all", "joint_ids_map: expected places of joints, found `all`"),
        ("joint_ids_map", [], "joint_ids_map: expected places of joints, found `[]`"),
        ("observations", {}, "observations: expected one group"),
        (
            "observations",
            {"joint_vel_rel": {"params": {}, "scale": "1/20"}},
            "observations.joint_vel_rel.scale: expected 1 numbers, found `1/20`",
        ),
        (
            "observations",
            {"joint_vel_rel": {"params": {}, "clip": [1.0, -1.0]}},
            "clip: expected the least and the most, found `[1.0, -1.0]`",
        ),
        (
            "actions",
            {"JointPositionAction": {"clip": 100.0}},
            "clip: expected a pair for each of 12 joints",
        ),
        (
            "stiffness",
            [20.0],
            "stiffness: it ends at motor 0 of the bus; the policy drives motor 11",
        ),
        ("stiffness", [20.0] * 13, "stiffness: expected 12 numbers, found 13"),
        ("step_dt", None, "step_dt: it is missing"),
        ("default_joint_pos", None, "default_joint_pos: it is missing"),
        ("step_dt", "fast", "step_dt: expected a number, found `fast`"),
        ("step_dt", 0.0, "it acts every 0 s"),
        ("stiffness", [math.inf] * 12, "numbers that are not finite"),
        ("observations", {"joint_pos_rel": {"params": {}, "history_length": 10**9}}, "looks back"),
        ("observations", {"joint_pos_rel": {"params": {}, "history_length": -1}}, "back -1 steps"),
        ("actions", {"JointEffortAction": {}}, "expected `JointPositionAction` alone"),
    ],
)
def test_a_wrong_deploy_yaml_is_one_error_that_names_the_key(
    key: str, value: object, message: str, bot: Bot, tmp_path: Path
):
    write_policy(tmp_path / "p", deployed(bot))
    said = deployed(bot) | {key: value}
    (tmp_path / "p/deploy.yaml").write_text(yaml.safe_dump(said))
    with pytest.raises(UsageError, match=r"deploy\.yaml") as raised:
        open_policy(tmp_path / "p", bot)
    assert message in str(raised.value)


def test_env_yaml_is_read_by_patterns_in_isaac_lab_s_order(bot: Bot, tmp_path: Path):
    (tmp_path / "env.yaml").write_text(ENV)
    policy = open_policy(tmp_path / "env.yaml", bot)
    assert policy.joints == policy.acts_on == bot.orders["isaaclab"]
    assert policy.kp["FR_thigh_joint"] == 25.0 and policy.kd["FR_calf_joint"] == 0.75
    assert policy.position["RL_calf_joint"] == -1.8 == policy.offset["RL_calf_joint"]
    assert (policy.scale["FL_hip_joint"], policy.scale["FL_calf_joint"]) == (0.125, 0.25)
    assert policy.step_s == pytest.approx(0.02) and sees(policy) == 3 + 3 + 3 * 12 + 12 + 2
    assert [term.function for term in policy.terms] == [
        "base_ang_vel", "velocity_commands", "joint_pos_rel", "last_action", "gait_phase",
    ]  # fmt: skip
    assert policy.terms[3].clip == (-5.0, 5.0) and policy.terms[4].params == {"period": 0.8}
    assert policy.action_clip == {
        f"{leg}_hip_joint": (-0.5, 0.5) for leg in ("FR", "FL", "RR", "RL")
    }


def test_env_yaml_of_a_robot_with_fewer_joints_counts_its_own(bot: Bot, tmp_path: Path):
    """Joints without a drive there are fixed, so that what hangs on them is one step nearer."""
    text = ENV.replace('joint_names_expr: [".*_hip_joint", ".*_thigh_joint"]',
                       'joint_names_expr: ["F[LR]_hip_joint", ".*_thigh_joint"]')  # fmt: skip
    (tmp_path / "env.yaml").write_text(text)
    policy = open_policy(tmp_path / "env.yaml", bot)
    hips, thighs = ("FL_hip_joint", "FR_hip_joint"), ("RL_thigh_joint", "RR_thigh_joint")
    assert policy.joints[:4] == (*hips, *thighs) and len(policy.joints) == 10
    assert [f.rule for f in compare(policy, bot) if f.severity == "warning"] == []


@pytest.mark.parametrize(
    ("stated", "instead", "message"),
    [
        (
            "params: {}, scale: 0.2}",
            "params: {}, modifiers: [{func: filter}]}",
            "modifiers: observations that are modified",
        ),
        (
            ":JointPositionAction",
            ":RelativeJointPositionAction",
            "actions: expected one JointPositionAction, found `joint_pos` \\(RelativeJoint",
        ),
        ("  policy:", "  actor:", "observations.policy: it is missing"),
    ],
)
def test_what_env_yaml_cannot_be_replayed_with_is_refused(
    stated: str, instead: str, message: str, bot: Bot, tmp_path: Path
):
    assert stated in ENV
    (tmp_path / "env.yaml").write_text(ENV.replace(stated, instead))
    with pytest.raises(UsageError, match=message):
        open_policy(tmp_path / "env.yaml", bot)


def metadata(bot: Bot) -> dict[str, str]:
    def row(values: Any) -> str:
        return ",".join(f"{value:.3f}" for value in values)

    joints = bot.orders["mujoco"]
    return {
        "joint_names": ", ".join(joints),
        "joint_stiffness": row(bot.kp[name] for name in joints),
        "joint_damping": row(bot.kd[name] for name in joints),
        "default_joint_pos": row(bot.position[name] for name in joints),
        "action_scale": row(0.25 for _ in joints),
        "observation_names": "base_lin_vel,base_ang_vel,projected_gravity,joint_pos,joint_vel,"
        "actions,command",
        "observation_terms_scale": "1.0,1.0,1.0,1.0,0.05,1.0,2.0;2.0;0.25",
        "observation_terms_clip": ",".join(["-inf;inf"] * 7),
        "observation_terms_history_length": ",".join(["0"] * 7),
    }


def described(path: Path, said: dict[str, str]) -> Path:
    """A network with metadata."""
    graph = helper.make_graph(
        [helper.make_node("Identity", ["obs"], ["actions"])],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 48])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, 48])],
    )
    save(path, graph, said)
    return path


def test_mjlab_s_metadata_name_the_joints(bot: Bot, tmp_path: Path):
    policy = open_policy(described(tmp_path / "policy.onnx", metadata(bot)), bot)
    assert policy.joints == bot.orders["mujoco"] and policy.step_s is None and sees(policy) == 48
    assert policy.terms[0].function == "imu_lin_vel" and policy.terms[4].scale == (0.05,)
    assert policy.terms[6].scale == (2.0, 2.0, 0.25) and policy.terms[6].clip == (
        -math.inf,
        math.inf,
    )
    said = metadata(bot) | {"observation_names": "phase"}
    (phase,) = open_policy(described(tmp_path / "policy.onnx", said), bot).terms
    assert bot.cannot_see(phase) == "the period of its gait is not stated"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("action_scale", "fast", "action_scale: `fast` are no numbers"),
        ("default_joint_pos", "0.0,0.1", "expected 12 numbers, found 2"),
        ("joint_names", ",".join(["FL_hip_joint"] * 12), "it names one joint twice"),
        ("observation_names", None, "does not say which joints it drives"),
    ],
)
def test_wrong_metadata_are_one_error(
    key: str, value: str | None, message: str, bot: Bot, tmp_path: Path
):
    said = metadata(bot) | ({key: value} if value else {})
    if value is None:
        del said[key]
    with pytest.raises(UsageError, match=message):
        open_policy(described(tmp_path / "policy.onnx", said), bot)


def test_what_describes_no_policy_is_refused_with_a_hint(bot: Bot, tmp_path: Path):
    with pytest.raises(UsageError, match="holds no policy") as raised:
        open_policy(tmp_path, bot)
    assert "deploy.yaml" in raised.value.hint
    (tmp_path / "policy.yaml").write_text("policy_path: motion.pt\nkps: [100, 150]\n")
    with pytest.raises(UsageError, match=r"neither a deploy\.yaml.* nor Isaac Lab's env\.yaml"):
        open_policy(tmp_path / "policy.yaml", bot)


def test_of_several_networks_the_one_called_policy_is_meant(bot: Bot, tmp_path: Path):
    folder = write_policy(tmp_path, deployed(bot))
    write_network(folder / "encoder.onnx", 45, 12)
    assert open_policy(folder, bot).network == folder / "policy.onnx"
    actor = (folder / "policy.onnx").rename(folder / "walk.onnx")
    with pytest.raises(UsageError, match=r"several networks: `encoder\.onnx`, `walk\.onnx`"):
        open_policy(folder, bot)
    assert open_policy(actor, bot).network == actor


JUNK = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 3), st.floats(), st.text(max_size=3),
    st.lists(st.integers(-2, 40), max_size=3), st.dictionaries(st.text(max_size=2), st.none()),
)  # fmt: skip


def paths_of(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in plain data."""
    if not isinstance(value, dict | list):
        return []
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return [p for key, item in items for p in ((*path, key), *paths_of(item, (*path, key)))]


@pytest.mark.parametrize("name", ["deploy.yaml", "env.yaml"])
@given(data=st.data())
@settings(max_examples=examples(80), deadline=None)
def test_whatever_stands_there_is_read_or_is_one_error(name: str, data: st.DataObject, bot: Bot):
    """One value anywhere is another one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(ENV)
        said = deployed(bot) if name == "deploy.yaml" else read_yaml(path)
        place = data.draw(st.sampled_from(paths_of(said)))
        inside = said
        for key in place[:-1]:
            inside = inside[key]
        inside[place[-1]] = data.draw(JUNK)
        path.write_text(yaml.safe_dump(said, sort_keys=False))
        with suppress(UsageError):
            list(compare(open_policy(path, bot), bot))


# --- YAML of strangers ---------------------------------------------------------------------------


def test_an_alias_that_grows_without_end_is_one_object(tmp_path: Path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30)]
    (tmp_path / "bomb.yaml").write_text("\n".join(lines))
    assert len(read_yaml(tmp_path / "bomb.yaml")["a29"]) == 9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1, 2", "bomb.yaml:1"),
        ("- 1", "holds no mapping"),
        ("a: " + "[" * 500, "not readable"),
    ],
)
def test_what_is_no_yaml_is_one_error(text: str, message: str, tmp_path: Path):
    (tmp_path / "bomb.yaml").write_text(text)
    with pytest.raises(UsageError) as raised:
        read_yaml(tmp_path / "bomb.yaml")
    assert message in str(raised.value)


def test_tags_of_python_make_no_objects(tmp_path: Path):
    (tmp_path / "env.yaml").write_text(
        "a: !!python/object/apply:os.system [touch owned]\nb: !!python/name:os.x ''\n"
    )
    assert read_yaml(tmp_path / "env.yaml") == {"a": ["touch owned"], "b": ""}
