"""The JSON Schema speaks of the keys that people write."""

from __future__ import annotations

import json

from assetbuild.pipeline.recipes import schema_text, whole_model
from assetbuild.recipe.schema import allowed_values, known_keys, meaning


def test_the_schema_is_json_with_the_keys_of_the_file():
    schema = json.loads(schema_text())
    assert {"schema", "validate", "robot"} <= set(schema["properties"])
    assert "schema_" not in schema["properties"]
    assert "from" in schema["$defs"]["HullRule"]["properties"]
    assert schema["additionalProperties"] is False


def test_the_schema_is_the_same_each_time():
    assert schema_text() == schema_text()


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
