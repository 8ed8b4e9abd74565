"""Every key of the configuration with its default, its kind and its bounds, as they were decided.

tests/data/config_bounds.json is the schema without its words. A bound that changes is a decision, and changes there.
"""

import json
from pathlib import Path
from typing import Any

from rig.plan.config import Config

DECIDED = Path(__file__).parents[1] / "data" / "config_bounds.json"


def _without_words(schema: Any) -> Any:
    if isinstance(schema, dict):
        return {key: _without_words(value) for key, value in schema.items() if key not in ("description", "title")}
    return [_without_words(value) for value in schema] if isinstance(schema, list) else schema


def test_every_key_has_the_default_and_the_bounds_that_were_decided() -> None:
    assert _without_words(Config.model_json_schema()) == json.loads(DECIDED.read_text(encoding="utf-8"))
