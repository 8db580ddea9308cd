"""A file that a CAD program wrote is named, and its limits are doubted where all are alike."""

from __future__ import annotations

import pytest

from assetbuild.robot.model import Body, Joint, Limits, Tree
from assetbuild.source.urdf.exporters import exporter_findings

ONSHAPE = "<!-- Generated using onshape-to-robot -->"
SOLIDWORKS = "<!-- created by SolidWorks to URDF Exporter! -->"
SAME, OTHER = Limits(-1.0, 1.0, 10.0, 10.0), Limits(-1.0, 1.0, 12.0, 10.0)


@pytest.mark.parametrize(
    ("head", "last", "rules"),
    [
        (ONSHAPE, SAME, ["export.onshape", "export.limits_alike"]),
        (SOLIDWORKS, SAME, ["export.solidworks", "export.limits_alike"]),
        (ONSHAPE, OTHER, ["export.onshape"]),
        ("<!-- by hand -->", SAME, []),
    ],
)
def test_what_an_exporter_writes_where_nobody_states_limits(
    head: str, last: Limits, rules: list[str]
):
    names = ("base", "a", "b", "c")
    joints = tuple(
        Joint(f"{child}_j", "revolute", parent, child, limits=limits)
        for parent, child, limits in zip(names, names[1:], (SAME, SAME, last), strict=False)
    )
    tree = Tree("bot", "fixed", tuple(map(Body, names)), joints)
    found = list(exporter_findings(f"{head}<robot/>".encode(), tree))
    assert [finding.rule for finding in found] == rules
