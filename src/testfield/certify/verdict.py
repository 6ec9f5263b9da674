"""One line of a certificate."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """A figure that was measured against its limit.

    `part` of the certificate (geometry, light, lens, focus, sensor, sameness), `name` of the figure, `measured` value
    and its `limit` in `unit`; the verdict passes where `measured` does not exceed `limit`. `how` says in one sentence
    how it was measured.
    """

    part: str
    name: str
    measured: float
    limit: float
    unit: str
    how: str

    @property
    def passed(self) -> bool:
        """Whether the figure keeps its limit; a figure that is not a number does not."""
        return bool(self.measured <= self.limit)
