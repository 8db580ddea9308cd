"""The JSON Schema speaks of the keys that people write."""

from __future__ import annotations

import json

import pytest
from pydantic import ValidationError

from assetbuild.pipeline.recipes import collision_rule, schema_text, whole_model
from assetbuild.recipe.schema import allowed_values, known_keys, meaning


def test_the_schema_is_json_with_the_keys_of_the_file():
    schema = json.loads(schema_text())
    assert {"schema", "validate", "robot"} <= set(schema["properties"])
    assert "schema_" not in schema["properties"]
    assert "from" in schema["$defs"]["HullRule"]["properties"]
    assert schema["additionalProperties"] is False


def test_every_key_has_a_meaning():
    for name, model in json.loads(schema_text())["$defs"].items():
        assert model.get("description"), name
        for key, value in model["properties"].items():
            assert value.get("description") or "$ref" in json.dumps(value), f"{name}.{key}"


def test_keys_are_found_below_patterns_lists_and_choices():
    assert "shape" in known_keys(whole_model(), ("collision", "links", ".*_foot"))
    assert "kp" in known_keys(whole_model(), ("actuators", 3))
    assert "seconds" in known_keys(whole_model(), ("validate", "stand"))
    assert known_keys(whole_model(), ("motors",)) == []
    assert allowed_values(whole_model(), ("base",)) == ["floating", "fixed"]
    assert meaning(whole_model(), ("actuators", 0, "kp")) == "N m/rad or N/m"


@pytest.mark.parametrize(
    ("written", "metres"),
    [("5 mm", 0.005), ("0.5 cm", 0.005), ("0.005 m", 0.005), (0.005, 0.005), ("20um", 2e-5)],
)
def test_a_length_is_in_metres_whatever_its_unit(written, metres):
    assert collision_rule(max_outside=written).max_outside == metres


@pytest.mark.parametrize(("written", "share"), [("2 %", 0.02), ("20%", 0.2), (0.2, 0.2)])
def test_a_share_may_be_percent(written, share):
    assert collision_rule(max_overcover=written).max_overcover == share


@pytest.mark.parametrize("written", ["5 parsec", "5", "mm", "1e5e5 mm", "-5 mm", "2 %", "nan mm"])
def test_another_unit_is_an_error_that_shows_a_right_one(written):
    with pytest.raises(ValidationError) as caught:
        collision_rule(max_outside=written)
    message = str(caught.value)
    assert "`5 mm`" in message or "greater than or equal to 0" in message or "finite" in message
