"""Parquet, with plain columns and with lists as LeRobot writes them."""

import json
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from logs import JOINTS, arm
from tiny import run_step

from assetbuild.errors import StepError
from assetbuild.identify.read_log import ReadLog
from assetbuild.identify.table import element_names, info_beside, read_columns
from assetbuild.robot.codec import encode
from assetbuild.robot.identify import Columns

COLUMNS = ("timestamp", "observation.state[1]", "action[0]")


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
    table = read_columns(episode, episode.name, COLUMNS, None, 1.0)
    assert table[:, 1:].tolist() == [[1.0, 10.0], [3.0, 12.0], [5.0, 14.0]]


@pytest.mark.parametrize(
    ("column", "said"),
    [("observation.states[1]", "has no column"), ("action[7]", "column `action` has no element 7")],
)
def test_what_it_has_not(episode, column, said):
    with pytest.raises(StepError, match=said):
        read_columns(episode, episode.name, ("timestamp", column), None, 1.0)


def test_a_broken_file(episode):
    episode.write_bytes(episode.read_bytes()[:100])
    with pytest.raises(StepError, match="is not a Parquet file"):
        read_columns(episode, episode.name, COLUMNS, None, 1.0)


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


def read(data_set, tmp_path, **keys):
    inputs = tmp_path / "in"
    inputs.mkdir()
    (inputs / "tree.json").write_bytes(encode(arm()))
    shutil.copy(data_set, inputs / "log")
    shutil.copy(info_beside(data_set), inputs / "info.json")
    patterns = {"position": "observation.state[{joint}.pos]", "target": "action[{joint}.pos]"}
    columns = Columns(time="timestamp", **patterns)
    step = ReadLog(file=data_set.name, joints=JOINTS, columns=columns, **keys)
    run_step(step, inputs, tmp_path / "out")
    return np.load(tmp_path / "out/record.npz")


def test_an_episode_of_a_lerobot_data_set_by_the_names_of_its_info(data_set, tmp_path):
    record = read(data_set, tmp_path, episode=1)
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
        read(data_set, tmp_path, **keys)


def test_an_info_that_is_none():
    with pytest.raises(StepError, match="no readable `features`"):
        element_names(b"[]", "file-000.parquet")
