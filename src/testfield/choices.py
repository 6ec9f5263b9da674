"""The name of something registered, where a person's file gives it."""

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import PydanticKnownError, core_schema

from testfield.registry import names


@dataclass(frozen=True)
class Registered:
    """Says of a text in a pydantic model that it must be a name of a `kind`, looked up whenever it is checked."""

    kind: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_after_validator_function(self._known, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(schema), "enum": names(self.kind)}

    def _known(self, name: str) -> str:
        known = names(self.kind)
        if name not in known:
            *others, last = [f"'{one}'" for one in known]
            raise PydanticKnownError("literal_error", {"expected": f"{', '.join(others)} or {last}"})
        return name


LensName = Annotated[str, Registered("lenses")]
