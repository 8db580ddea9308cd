"""Small grippers as MJCF: two fingers that face each other, and a jaw that closes on its palm."""

from __future__ import annotations

from pathlib import Path

FINGER = """<body name="{name}" pos="0 {y} 0"><joint name="{name}" type="slide" axis="0 {axis} 0"
range="0 0.04" damping="5"/><geom type="box" size=".01 .005 .03" pos="0 {inner} .03"
mass=".05"/></body>"""
PINCHER = FINGER.format(name="left", y=0.0, axis=1, inner=0.005) + FINGER.format(
    name="right", y=0.0, axis=-1, inner=-0.005
)
JAW = """<geom type="box" size=".01 .005 .05" pos="0 -.02 .06" mass=".1"/>
<body name="jaw" pos="0 .015 .01"><joint name="jaw" axis="1 0 0" range="-1.5 0" armature=".01"/>
<geom type="box" size=".01 .005 .05" pos="0 -.02 .05" mass=".05"/></body>"""
COUPLED = '<equality><joint joint1="right" joint2="left" polycoef="0 1 0 0 0"/></equality>'


def robot(inside: str, joints: list[str], folder: Path, more: str = "") -> Path:
    servos = "".join(
        f'<position joint="{joint}" kp="400" kv="20" forcerange="-40 40"/>' for joint in joints
    )
    path = folder / "robot.xml"
    path.write_text(
        '<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast" '
        'cone="elliptic" impratio="50"/><worldbody><body name="base" pos="0 0 .5">'
        '<geom size=".03" mass="1" contype="0" conaffinity="0"/><body name="palm" pos="0 0 .05">'
        '<geom type="box" size=".02 .05 .005" mass=".2" pos="0 0 -.005"/>'
        f"{inside}</body></body></worldbody>{more}<actuator>{servos}</actuator></mujoco>"
    )
    return path
