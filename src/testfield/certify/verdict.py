"""One line of a certificate."""

from dataclasses import dataclass

from testfield.evaluate.check import Check, Limit


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
    def check(self) -> Check:
        """The figure held against its limit."""
        name, limit = f"{self.part}: {self.name}", Limit(most=self.limit)
        return Check(name=name, value=self.measured, limit=limit, unit=self.unit, how=self.how)

    @property
    def passed(self) -> bool:
        """Whether the figure keeps its limit; a figure that is not a number does not."""
        return self.check.passed
