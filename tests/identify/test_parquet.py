"""Parquet, with plain columns and with lists as LeRobot writes them."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from assetbuild.errors import StepError
from assetbuild.identify.table import read_columns

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
