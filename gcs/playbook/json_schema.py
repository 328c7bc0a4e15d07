"""The JSON Schema of a playbook, for editors that complete and check while it is written."""

from __future__ import annotations

from typing import Any, Final

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from gcs.playbook.schema import Playbook

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


class _Strict(GenerateJsonSchema):
    """What a playbook refuses, its schema refuses; and no titles that only repeat a key."""

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        made = super().dict_schema(schema)
        return {**made, "additionalProperties": False} if "patternProperties" in made else made

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002 - pydantic asks for each field
        return False


def playbook_schema() -> dict[str, Any]:
    """Return the JSON Schema of a playbook; what it cannot say, as of places too near each other, loading says."""
    made = Playbook.model_json_schema(schema_generator=_Strict)
    return {"$schema": DIALECT, **made, "title": "bearing-relay playbook"}
