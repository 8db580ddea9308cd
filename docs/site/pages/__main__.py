"""Renew `docs/reference/recipe.schema.json`, by which editors complete recipes of a checkout."""

from __future__ import annotations

from pathlib import Path

from assetbuild.pipeline.recipes import schema_text

SCHEMA = Path(__file__).parents[2] / "reference/recipe.schema.json"

SCHEMA.write_text(schema_text(), encoding="utf-8")
