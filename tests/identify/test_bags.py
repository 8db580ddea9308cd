"""Bags: the columns of topics, and one sentence for what a bag has not."""

import numpy as np
import pytest
from logs import JOINTS, RATE_HZ, chirps
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from assetbuild.errors import StepError
from assetbuild.identify.table import read_columns

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
