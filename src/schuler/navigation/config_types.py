"""What all configurations and their sections share."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from schuler.exceptions import ConfigError, sentences

Triple = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]


class Section(BaseModel):
    """Base of all sections: immutable, nothing unknown."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Config(Section):
    """Base of whole configurations."""

    @classmethod
    def parse(cls, data: dict[str, Any], source: str = "configuration") -> Self:
        """Checked configuration of nested dictionaries; all faults are reported at once.

        Raises
        ------
        ConfigError
            Listing every wrong entry with its place.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise ConfigError(f"{source}: " + "; ".join(sentences(error, cls))) from None
