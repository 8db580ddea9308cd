"""Columns of bags and of Parquet files are read, or refused with what they hold."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from logs import JOINTS, RATE_HZ, chirps, read
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from assetbuild.errors import StepError
from assetbuild.identify.table import element_names, info_beside, read_columns
from assetbuild.robot.identify import Columns

TYPES = get_typestore(Stores.ROS2_HUMBLE)
STATE, ARRAY = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"
COLUMNS = (
    "stamp",
    *(f"/joint_states.position[{joint}]" for joint in JOINTS),
    *(f"/commands.data[{n}]" for n in range(len(JOINTS))),
)


def message(kind, **values):
    return TYPES.types[kind](**values)


def state(at_s, q):
    stamp = message("builtin_interfaces/msg/Time", sec=int(at_s), nanosec=round(at_s % 1 * 1e9))
    header = message("std_msgs/msg/Header", stamp=stamp, frame_id="")
    # The driver lists the joints in another order than the recipe.
    return message(
        STATE,
        header=header,
        name=list(JOINTS[::-1]),
        position=q[::-1].copy(),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )


def command(u):
    layout = message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return message(ARRAY, layout=layout, data=u)


def recorded(folder, storage):
    """A bag in which each command comes a tenth of a period before the state; (bag, q, u)."""
    u = chirps(2.0)
    q = 0.9 * u
    bag = folder / "bag"
    with Writer(bag, version=8, storage_plugin=storage) as writer:
        states = writer.add_connection("/joint_states", STATE, typestore=TYPES)
        commands = writer.add_connection("/commands", ARRAY, typestore=TYPES)
        for n in range(len(u)):
            at = 100.0 + n / RATE_HZ
            early = round((at - 0.1 / RATE_HZ) * 1e9)
            writer.write(commands, early, TYPES.serialize_cdr(command(u[n]), ARRAY))
            cdr = TYPES.serialize_cdr(state(at, q[n]), STATE)
            writer.write(states, round(at * 1e9) + 2_000_000, cdr)
    return next(file for file in bag.iterdir() if file.suffix in (".mcap", ".db3")), q, u


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_two_topics_are_one_table_by_the_names_of_the_joints(tmp_path, storage):
    bag, q, u = recorded(tmp_path, storage)
    table = read_columns(bag, bag.name, COLUMNS, None, 1.0)
    assert len(table) == len(u)
    assert table[:, 0] == pytest.approx(100.0 + np.arange(len(u)) / RATE_HZ, abs=1e-6)
    assert np.array_equal(table[:, 1:], np.hstack([q, u]))


def test_the_recorders_clock(tmp_path):
    bag, _, _ = recorded(tmp_path, StoragePlugin.MCAP)
    table = read_columns(bag, bag.name, ("received", *COLUMNS[1:]), None, 1.0)
    assert table[0, 0] == pytest.approx(100.002, abs=1e-6)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (("t", *COLUMNS[1:]), "a bag has no column `t`"),
        (("stamp", "/joint_state.position[shoulder]"), "no topic `/joint_state`"),
        (("stamp", "/joint_states.position[wrist]"), "no number `/joint_states.position[wrist]`"),
        (("stamp", "/joint_states.velocity[shoulder]"), "no number"),
        (("stamp", "position_shoulder"), "`position_shoulder` is no field of a topic"),
        (("stamp", "/commands.data[0]"), "messages of `/commands` have no header"),
    ],
)
def test_what_a_bag_has_not_is_named(tmp_path, columns, said):
    bag, _, _ = recorded(tmp_path, StoragePlugin.MCAP)
    with pytest.raises(StepError, match=r".") as error:
        read_columns(bag, bag.name, columns, None, 1.0)
    assert said in error.value.message and error.value.hint


@pytest.mark.parametrize("size", [0, 9, 3000])
def test_a_bag_that_is_cut_off_is_refused(tmp_path, size):
    bag, _, _ = recorded(tmp_path, StoragePlugin.MCAP)
    bag.write_bytes(bag.read_bytes()[:size])
    with pytest.raises(StepError, match="cannot be read as a bag"):
        read_columns(bag, bag.name, COLUMNS, None, 1.0)


COLUMNS_OF_PARQUET = ("timestamp", "observation.state[1]", "action[0]")


@pytest.fixture
def episode(tmp_path):
    """Three frames of two joints."""
    state, action = np.arange(6.0).reshape(3, 2), 10.0 + np.arange(6.0).reshape(3, 2)
    table = {
        "timestamp": np.array([0.0, 0.02, 0.04], np.float32),
        "observation.state": pa.array(state.tolist(), pa.list_(pa.float32(), 2)),
        "action": pa.array(action.tolist(), pa.list_(pa.float32(), 2)),
    }
    pq.write_table(pa.table(table), tmp_path / "episode_000000.parquet")
    return tmp_path / "episode_000000.parquet"


def test_elements_of_lists(episode):
    table = read_columns(episode, episode.name, COLUMNS_OF_PARQUET, None, 1.0)
    assert table[:, 1:].tolist() == [[1.0, 10.0], [3.0, 12.0], [5.0, 14.0]]


@pytest.mark.parametrize(
    ("column", "said"),
    [("observation.states[1]", "has no column"), ("action[7]", "column `action` has no element 7")],
)
def test_what_it_has_not(episode, column, said):
    with pytest.raises(StepError, match=said):
        read_columns(episode, episode.name, ("timestamp", column), None, 1.0)


@pytest.fixture
def data_set(tmp_path):
    """Version 3: two episodes of 3 s in one file, each with its own clock; an info.json."""
    count = 150
    t = np.arange(count) / 50.0
    state = np.stack([0.3 * np.sin(3.0 * t), 0.2 * np.cos(2.0 * t)], axis=1)
    chunk = tmp_path / "moves/data/chunk-000"
    chunk.mkdir(parents=True)
    columns = {
        "timestamp": np.concatenate([t, t]).astype(np.float32),
        "episode_index": np.repeat([0, 1], count),
        "observation.state": [*state.tolist(), *(-state).tolist()],
        "action": [*state.tolist(), *(-state).tolist()],
    }
    pq.write_table(pa.table(columns), chunk / "file-000.parquet")
    named = {"dtype": "float32", "shape": [2], "names": ["shoulder.pos", "elbow.pos"]}
    grouped = {**named, "names": {"motors": ["shoulder.pos", "elbow.pos"]}}
    features = {"observation.state": named, "action": grouped, "timestamp": {"names": None}}
    info = {"codebase_version": "v3.0", "fps": 50, "features": features}
    (tmp_path / "moves/meta").mkdir()
    (tmp_path / "moves/meta/info.json").write_text(json.dumps(info))
    return chunk / "file-000.parquet"


def read_data_set(data_set, tmp_path, **keys):
    (tmp_path / "in").mkdir()
    shutil.copy(info_beside(data_set), tmp_path / "in/info.json")
    patterns = {"position": "observation.state[{joint}.pos]", "target": "action[{joint}.pos]"}
    columns = Columns(time="timestamp", **patterns)
    return read(tmp_path, data_set, file=data_set.name, columns=columns, **keys)


def test_an_episode_of_a_lerobot_data_set_by_the_names_of_its_info(data_set, tmp_path):
    _, record = read_data_set(data_set, tmp_path, episode=1)
    assert len(record["position_0"]) == 150
    assert record["position_0"][10] == pytest.approx([-0.3 * np.sin(0.6), -0.2 * np.cos(0.4)])


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, "holds several episodes"),
        ({"episode": 7}, r"has no episode 7; it has 0\.\.1"),
        ({"episode": 0, "names": {"elbow": "wrist"}}, r"has no element `wrist.pos`"),
    ],
)
def test_what_a_data_set_has_not(data_set, tmp_path, keys, said):
    with pytest.raises(StepError, match=said):
        read_data_set(data_set, tmp_path, **keys)


def test_an_info_that_is_none():
    with pytest.raises(StepError, match="no readable `features`"):
        element_names(b"[]", "file-000.parquet")


def test_a_broken_file(episode):
    episode.write_bytes(episode.read_bytes()[:100])
    with pytest.raises(StepError, match="is not a Parquet file"):
        read_columns(episode, episode.name, COLUMNS_OF_PARQUET, None, 1.0)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("0.0,1\n,2\n0.2,3\n", "`t` is not a number in row 2"),
        ("0.0,1\nlate,2\n0.2,3\n", "`t` is not a number in row 2"),
        ("0.0,1\n0.1,2,3\n", "log.csv:3: 3 cells, but the header names 2"),
    ],
)
def test_a_row_that_is_none_is_refused_with_its_place(tmp_path, rows, said):
    log = tmp_path / "log.csv"
    log.write_text(f"t,q\n{rows}")
    with pytest.raises(StepError, match=said):
        read_columns(log, log.name, ("t", "q"), (0.0, 1.0), 1.0)


def test_a_comma_at_the_end_of_a_line_is_none_too_many(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t,q\n0.0,1,\n0.1,2\n")
    assert read_columns(log, log.name, ("t", "q"), None, 1.0).tolist() == [[0.0, 1.0], [0.1, 2.0]]
