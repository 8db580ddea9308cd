"""The speed of a scene whose contacts are known."""

from __future__ import annotations

import pytest

from assetbuild.simulators import speed

SCENE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 0.1"><freejoint/><geom name="a" type="sphere" size="0.1"/>
      <body pos="0.5 0 0"><joint type="slide"/><geom type="sphere" size="0.1"/>
        <body pos="-0.35 0 0"><joint type="slide"/><geom type="sphere" size="0.1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_geoms_and_own_contacts_at_home_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "STEPS", 20)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    found = speed.measure_speed(path)
    assert found.geoms == 3
    # The third ball is 0.15 m from the first, which is not its parent: 50 mm deep.
    assert found.self_contacts == 1
    assert found.deepest_mm == pytest.approx(50.0, abs=0.1)
    assert found.steps_per_s > 0.0
    assert (found.creep_mm_s, found.held) == (None, ""), "it lies there, and has no hand"
